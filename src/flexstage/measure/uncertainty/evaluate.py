"""A budget by the GUM and by Monte Carlo: one result, as the command prints it."""

from dataclasses import dataclass
from typing import Any, ClassVar

from flexstage.files.plain import picked, plain
from flexstage.files.request import request_of
from flexstage.files.result import Result
from flexstage.measure.requests import UncertaintyRequest
from flexstage.measure.uncertainty.budget_file import Budget
from flexstage.measure.uncertainty.monte_carlo import MonteCarlo, validate
from flexstage.measure.uncertainty.propagate import Propagated


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class EvaluatedBudget(Result):
    """An uncertainty budget, propagated in both ways."""

    table_key: ClassVar[str] = "influences"

    budget: Budget
    """The budget."""
    propagated: Propagated
    """Its result to first order, in SI."""
    drawn: MonteCarlo
    """Its result by Monte Carlo, in SI."""

    def data(self) -> dict[str, Any]:
        budget, propagated, drawn = self.budget, self.propagated, self.drawn
        verdict = validate(propagated, drawn)
        scale = 1.0 / budget.factor

        def scaled(ends: tuple[float, float]) -> list[float]:
            return [scale * end for end in ends]

        ends = propagated.interval(drawn.confidence)
        u = propagated.uncertainty
        return {
            "quantity": budget.quantity,
            "unit": budget.unit,
            "equation": budget.equation.text,
            "confidence": drawn.confidence,
            "influences": [
                {
                    **picked(line, "name", "value", "standard_uncertainty=uncertainty"),
                    **picked(line, "unit", "degrees_of_freedom", "distribution", "kind"),
                    "sensitivity": scale * line.sensitivity,
                    "contribution": scale * line.contribution,
                    **picked(line, "share", "source"),
                }
                for line in propagated.lines
            ],
            "correlations": [
                {"between": [first, second], "coefficient": r}
                for first, second, r in budget.correlations
            ],
            "gum": {
                "value": scale * propagated.value,
                "standard_uncertainty": scale * u,
                "degrees_of_freedom": plain(propagated.degrees_of_freedom),
                "coverage_factor": 0.5 * (ends[1] - ends[0]) / u if u > 0.0 else None,
                "expanded_uncertainty": scale * 0.5 * (ends[1] - ends[0]),
                "interval": scaled(ends),
            },
            "monte_carlo": {
                "value": scale * drawn.value,
                "standard_uncertainty": scale * drawn.uncertainty,
                "interval": scaled(drawn.symmetric),
                "shortest_interval": scaled(drawn.shortest),
                "trials": drawn.trials,
                "seed": drawn.seed,
                "tolerance": None if drawn.tolerance is None else scale * drawn.tolerance,
            },
            "agreement": {
                "valid": verdict.valid,
                "tolerance": scale * verdict.tolerance,
                "low": scale * verdict.low,
                "high": scale * verdict.high,
            },
            "notes": [*_constants(budget), *propagated.notes, *filter(None, [budget.notes])],
        }


def evaluate(
    budget: Budget, request: UncertaintyRequest | None = None, **asked: Any
) -> EvaluatedBudget:
    """Propagate a budget to first order and by Monte Carlo.

    Fields of `UncertaintyRequest` may be named in place of those of a request.
    """
    request = request_of(UncertaintyRequest, request, asked)
    return EvaluatedBudget(
        request=request,
        budget=budget,
        propagated=budget.propagate(),
        drawn=budget.monte_carlo(request),
    )


def _constants(budget: "Budget") -> list[str]:
    exact = [i.name for i in budget.influences if i.standard_uncertainty == 0.0]
    if not exact:
        return []
    are = "is taken as a constant" if len(exact) == 1 else "are taken as constants"
    return [f"{', '.join(exact)} {are}, known exactly"]
