"""The best stage of a family: local search by slopes, a ladder of models, Pareto fronts."""
