"""Uncertainty by the GUM: influences, first order and Monte Carlo, budgets, sensors."""

from typing import TYPE_CHECKING

from flexstage.lazy import import_on_use

if TYPE_CHECKING:
    from flexstage.experiment.uncertainty.budget_file import Budget, read_budget
    from flexstage.experiment.uncertainty.correlation import Correlations, correlation_matrix
    from flexstage.experiment.uncertainty.expression import Expression
    from flexstage.experiment.uncertainty.influence import (
        DISTRIBUTIONS,
        Influence,
        influence_from,
    )
    from flexstage.experiment.uncertainty.monte_carlo import (
        MonteCarlo,
        Validation,
        monte_carlo,
        numerical_tolerance,
        validate,
    )
    from flexstage.experiment.uncertainty.propagate import BudgetLine, Propagated, propagate
    from flexstage.experiment.uncertainty.sensor import ROLES, SensorSetup, measured

__all__ = [
    "DISTRIBUTIONS",
    "ROLES",
    "Budget",
    "BudgetLine",
    "Correlations",
    "Expression",
    "Influence",
    "MonteCarlo",
    "Propagated",
    "SensorSetup",
    "Validation",
    "correlation_matrix",
    "influence_from",
    "measured",
    "monte_carlo",
    "numerical_tolerance",
    "propagate",
    "read_budget",
    "validate",
]

import_on_use(__name__)
