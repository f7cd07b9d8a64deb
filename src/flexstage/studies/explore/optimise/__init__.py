"""Optimisation of a stage: local and multi-fidelity search, Pareto fronts."""
