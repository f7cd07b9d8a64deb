"""The figures of a plan as JSON."""

import json
import math
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from flexstage.characteristic import MeasuredCharacteristic
from flexstage.experiments.results import (
    CentredStep,
    CharacterisedStep,
    CommandedStep,
    CompensatedStep,
    IdentifiedStep,
    MeasuredStep,
    PlanResult,
    StepResult,
    VerifiedStep,
)
from flexstage.provenance import provenance

#: What the figures of a reference that was followed are given in.
_RUN_UNITS = {
    "loop_width": "m",
    "tracking_rms": "m",
    "tracking_max": "m",
    "tracking_rms_percent": "% of the stroke",
    "reduction_percent": "% of the loop in open loop",
    "learning_errors": "m rms",
}


def results_text(result: PlanResult) -> str:
    """Return the figures of a plan as the text of a file."""
    return json.dumps(plain_results(result), indent=2, allow_nan=False) + "\n"


def plain_results(result: PlanResult) -> dict[str, Any]:
    """Return the figures of a plan as plain data."""
    made = asdict(provenance(result.plan, dict(result.settings)))
    return {
        "plan": result.title or result.plan.title,
        "stage": result.stage.name,
        "serial_number": result.serial_number,
        "origin": result.origin,
        "instrument": asdict(result.instrument),
        "operator": result.operator,
        "note": result.note,
        "started": result.started,
        "finished": result.finished,
        "duration": result.duration,
        "folder": str(result.folder),
        "figures": [_figure(f, result) for f in result.figures],
        "further_figures": [_figure(f, result) for f in result.further_figures],
        "steps": [_step(s, result) for s in result.steps],
        "notes": list(result.notes),
        "provenance": {k: v for k, v in made.items() if k != "created"},
    }


def _figure(figure: MeasuredCharacteristic, result: PlanResult) -> dict[str, Any]:
    low, high = figure.estimate.interval()
    in_place = result.drives_in_place(figure)
    return {
        "quantity": figure.quantity,
        "axis": figure.axis,
        "value": _number(figure.value),
        "unit": figure.unit,
        "uncertainty": _number(figure.uncertainty),
        "degrees_of_freedom": _number(figure.degrees_of_freedom),
        "interval": [_number(low), _number(high)],
        "origin": result.origin,
        "step": figure.test,
        "note": f"{figure.note}, drives in place".lstrip(", ") if in_place else figure.note,
        "published": [{"origin": r.origin, "value": r.value} for r in result.published_of(figure)],
    }


def _step(step: StepResult, result: PlanResult) -> dict[str, Any]:
    own = result.plan.step(step.name)
    head: dict[str, Any] = {"name": step.name, "verb": own.verb}
    if not isinstance(step, CharacterisedStep):
        axis = "".join(step.axes) if isinstance(step, CentredStep) else step.axis
        head["axis"] = axis
    return {**head, **_details(step, result)}


def _details(step: StepResult, result: PlanResult) -> dict[str, Any]:
    if isinstance(step, CommandedStep):
        return {
            "kind": step.kind,
            "unit": step.unit,
            "samples": int(step.time.size),
            "range": {a: [float(np.min(v)), float(np.max(v))] for a, v in step.values.items()},
            "notes": list(step.notes),
        }
    if isinstance(step, MeasuredStep):
        return {
            "test": step.test,
            "file": _relative(step.file, result),
            "samples": step.record.size,
            "sample_rate_hz": step.record.sample_rate_hz,
            "columns": {c.name: c.unit for c in step.record.channels},
            "taken_now": step.repeated,
            "notes": list(step.notes),
        }
    if isinstance(step, CharacterisedStep):
        return {
            "figures": [_figure(f, result) for f in step.figures],
            "notes": {r.test.name: list(r.notes) for r in step.found.results if r.notes},
        }
    if isinstance(step, IdentifiedStep):
        return {
            "model": step.kind,
            "file": _relative(step.file, result),
            "errors_percent": {k: _number(v) for k, v in step.errors_percent.items()},
            "deviation": step.deviation,
            "warnings": list(step.warnings),
        }
    if isinstance(step, CompensatedStep):
        error = step.predicted - step.reference
        return {
            "samples": int(step.time.size),
            "predicted_rms_error": float(np.sqrt(np.mean(error**2))),
            "notes": list(step.notes),
        }
    if isinstance(step, VerifiedStep):
        return _verified(step, result)
    return _centred(step)


def _verified(step: VerifiedStep, result: PlanResult) -> dict[str, Any]:
    return {
        "model": step.kind,
        "stroke": step.stroke,
        "rate_hz": step.rate_hz,
        "units": dict(_RUN_UNITS),
        "runs": [
            {
                "way": run.way,
                "loop_width": run.tracking.loop_width,
                "tracking_rms": run.tracking.rms,
                "tracking_max": run.tracking.largest,
                "tracking_rms_percent": 100.0 * run.tracking.rms / step.stroke,
                "reduction_percent": _number(run.reduction_percent),
                "learning_errors": [_number(e) for e in run.errors],
                "file": _relative(run.file, result),
                "notes": list(run.notes),
            }
            for run in step.runs
        ],
    }


def _centred(step: CentredStep) -> dict[str, Any]:
    return {k: _plain(v) for k, v in asdict(step).items() if k not in ("name", "axes")}


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {k: _plain(v) for k, v in value.items()}
    if isinstance(value, tuple | list):
        return [_plain(v) for v in value]
    return _number(value) if isinstance(value, float) else value


def _number(value: float | None) -> float | None:
    return None if value is None or not math.isfinite(value) else float(value)


def _relative(path: Path, result: PlanResult) -> str:
    return path.relative_to(result.folder).as_posix()
