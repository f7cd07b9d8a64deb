"""The view Analyse: state, computations and parts."""
