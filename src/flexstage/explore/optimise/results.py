"""An optimum and a front as plain data: what `optimise.json` holds."""

from typing import Any

from flexstage.arrays import Array
from flexstage.explore.figures import Figure
from flexstage.explore.optimise.front import Front
from flexstage.explore.optimise.optimum import Optimum
from flexstage.explore.optimise.problem import Problem
from flexstage.files.plain import picked, plain


def optimum_results(found: Optimum) -> dict[str, Any]:
    """Return an optimum as plain data, in SI units, frequencies in Hz."""
    return {
        **_problem(found.problem),
        "met": found.met,
        "gain": found.gain,
        "variables": [
            {
                **picked(variable, "name", "dimension", "low", "high", "described=usual"),
                "start": float(start),
                "best": float(best),
            }
            for variable, start, best in zip(
                found.problem.family.variables, found.start, found.point, strict=True
            )
        ],
        "figures": [
            {
                "model": level.model,
                "start": _named(found.figures, level.start),
                "best": _named(found.figures, level.best),
            }
            for level in found.levels
        ],
        "excess": {
            r.text: plain(float(e))
            for r, e in zip(found.problem.all_requirements, found.excess, strict=True)
        },
        "held": [plain(held) for held in found.held if held.kind != "goal"],
        "rates_of_exchange": [
            {
                "goal": held.goal.text,
                "value": held.value,
                "rate": 0.0 if rate is None else rate.rate,
                "of": found.problem.goals[0].figure.name,
            }
            for held, rate in zip(found.problem.exchanged, found.exchange, strict=True)
        ],
        "ladder": [
            {
                **picked(rung, "model", "evaluations"),
                "point": plain(rung.point),
                "expected": _named(found.figures, rung.expected),
                "found": _named(found.figures, rung.found),
            }
            for rung in found.rungs
        ],
        "history": [plain(step) for step in found.trace],
        **picked(found, "free", "unexplained", "evaluations", "seconds", "seed", "notes"),
        **picked(found, "provenance"),
    }


def front_results(found: Front) -> dict[str, Any]:
    """Return a front as plain data, with the chosen design."""
    names = found.problem.family.names
    return {
        **_problem(found.problem),
        "front": [
            {
                "variables": dict(zip(names, plain(point), strict=True)),
                "lumped": _named(found.figures, values),
            }
            for point, values in zip(found.points, found.values, strict=True)
        ],
        "asked": [
            {"point": number, found.model: _named(found.figures, values)}
            for number, values in zip(found.asked, found.found, strict=True)
        ],
        **picked(found, "chosen", "generations", "evaluations"),
        "optimum": optimum_results(found.optimum),
    }


def _problem(problem: Problem) -> dict[str, Any]:
    return {
        "stage": problem.family.template.source,
        "goals": [goal.text for goal in problem.goals],
        "requirements": [r.text for r in problem.requirements],
        "required_unasked": [r.text for r in problem.usual],
    }


def _named(figures: tuple[Figure, ...], values: Array) -> dict[str, Any]:
    return {f.name: plain(float(v)) for f, v in zip(figures, values, strict=True)}
