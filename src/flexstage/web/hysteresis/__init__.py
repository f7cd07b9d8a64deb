"""The view Hysteresis: state, computations and panels."""
