"""The view Design: state, computations and parts."""
