"""Uncertainty by the GUM: influences, first order and Monte Carlo, budgets, sensors."""
