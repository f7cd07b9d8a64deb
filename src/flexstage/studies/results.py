"""A study as plain data: what `results.json` holds."""

import json
import math
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from flexstage.characteristic import Characteristic
from flexstage.studies.models import ModelRun
from flexstage.system import Analysis, load_readings

if TYPE_CHECKING:
    from collections.abc import Mapping

    from flexstage.studies.compensation import AxisExperiment
    from flexstage.studies.measurement import MeasurementComparison
    from flexstage.studies.study import Study
    from flexstage.studies.virtual_experiments import CentringTrial


def characteristic_row(row: Characteristic) -> dict[str, Any]:
    """Return a characteristic as a row of the tidy table."""
    return {
        "quantity": row.quantity,
        "axis": row.axis,
        "origin": row.origin,
        "value": _finite(row.value),
        "unit": row.unit,
        "uncertainty": _finite(row.uncertainty),
        "note": row.note,
    }


def analysis_results(analysis: Analysis, *, responses: bool = False) -> dict[str, Any]:
    """Return an analysis as plain data; SI units, frequencies in Hz.

    With the motion of the probes under one unit of each load on the whole stage [m]; the frequency
    responses, which are long, where asked for.
    """
    readings = load_readings(analysis.system) if _is_held(analysis) else {}
    out: dict[str, Any] = {
        "model": analysis.system.model,
        "characteristics": [characteristic_row(row) for row in analysis.characteristics],
        "modes": {
            condition: [
                {"natural_frequency_hz": _finite(f), "damping_ratio": _finite(zeta)}
                for f, zeta in zip(found.frequency_hz, found.damping_ratio, strict=True)
            ]
            for condition, found in analysis.modes.items()
        },
        "hinge_stress": {
            axis: {hinge: _finite(value) for hinge, value in stress.items()}
            for axis, stress in analysis.hinge_stress.items()
        },
        "loads": {
            load.name: {"unit": load.unit, "readings": readings[load.name]}
            for load in analysis.system.loads
            if load.name in readings
        },
        "validity": list(analysis.validity),
        "provenance": asdict(analysis.provenance),
    }
    if responses:
        out["responses"] = [
            {
                "drive": response.drive,
                "probe": response.probe,
                "drives": response.drives,
                "input": response.input_kind,
                "unit": response.unit,
                "frequency_hz": [_finite(f) for f in response.frequency_hz],
                "real": [_finite(value.real) for value in response.value],
                "imaginary": [_finite(value.imag) for value in response.value],
            }
            for response in analysis.responses
        ]
    return out


def run_results(run: ModelRun) -> dict[str, Any]:
    """Return what a run has beyond its analysis, as plain data; SI units, frequencies in Hz.

    Only what there is of the meshes and their values, the path of each axis, and the buckling load
    of bars [N].
    """
    out: dict[str, Any] = {}
    if run.refinement is not None:
        out["refinement"] = {
            "quantity": run.refinement.quantity,
            "accuracy": run.refinement.accuracy,
            "estimate": _finite(run.refinement.estimate),
            "steps": [
                {
                    "order": step.settings.order,
                    "neck_size": step.settings.neck_size,
                    "unknowns": step.unknowns,
                    "seconds": round(step.seconds, 3),
                    "values": [
                        {"quantity": quantity, "axis": axis, "value": _finite(value)}
                        for (quantity, axis), value in step.values.items()
                    ],
                }
                for step in run.refinement.steps
            ],
        }
    if run.strokes:
        out["strokes"] = {
            path.axis: {
                "displacement": path.displacement.tolist(),
                "force": path.force.tolist(),
                "along": path.along.tolist(),
                "across": path.across.tolist(),
                "rotation": path.rotation.tolist(),
                "natural_frequency_hz_at_full_stroke": _finite(path.frequency_hz),
                "ratio_change": _finite(path.ratio_change),
            }
            for path in run.strokes
        }
    if run.bars:
        out["bar_buckling_load"] = {body: _finite(load) for body, load in run.bars.items()}
    return out


def study_results(study: "Study") -> dict[str, Any]:
    """Return a study as plain data.

    The tidy table of characteristics, and each model's modes, stress, validity, provenance.
    """
    stage = study.stage
    return {
        "stage": {"name": stage.name, "title": stage.title, "notes": list(stage.notes)},
        "characteristics": [characteristic_row(row) for row in study.characteristics],
        "models": {
            name: _without_table(a) | run_results(study.runs.get(name, ModelRun(analysis=a)))
            for name, a in study.analyses.items()
        },
        "left_out": dict(study.left_out),
        "hysteresis": experiment_results(study.experiments),
        "virtual_measurement": _virtual(study.virtual),
        "centring": centring_results(study.centring),
        "variants": {name: analysis_results(a) for name, a in study.variants.items()},
    }


def _virtual(found: "MeasurementComparison | str | None") -> dict[str, Any]:
    from flexstage.studies.measurement import measurement_results

    if found is None:
        return {}
    return {"left_out": found} if isinstance(found, str) else measurement_results(found)


def centring_results(found: "CentringTrial | str | None") -> dict[str, Any]:
    """Return what is left of the eccentricity [m] and every step as plain data; or why not."""
    if found is None:
        return {}
    if isinstance(found, str):
        return {"left_out": found}
    return {
        "kind": "virtual experiment",
        "left": found.left,
        "reached": found.done.reached,
        "reason": found.done.reason,
        "steps": [
            {
                "kind": step.kind,
                "command": list(step.command),
                "eccentricity": step.reading.length.value,
                "interval": list(step.reading.length.interval()),
                "predicted": None if step.predicted is None else step.predicted.value,
            }
            for step in found.done.steps
        ],
    }


def experiment_results(experiments: "Mapping[str, AxisExperiment]") -> dict[str, Any]:
    """Return the figures of the experiments as plain data, by axis.

    Stroke, widths, errors [m], reductions [%], and how good each model is [%].
    """
    return {
        axis: {
            "kind": "virtual experiment",
            "stroke": made.stroke,
            "loop_width": made.width,
            "model_deviation": made.deviation,
            "open_loop": _errors(made.open_loop),
            "runs": [
                {
                    "model": run.identification.kind,
                    "rms_percent": run.identification.rms_percent,
                    "heldout_rms_percent": run.identification.heldout_rms_percent,
                    "reduction_percent": run.reduction_percent,
                    **_errors(run.tracking),
                }
                for run in made.runs
            ],
        }
        for axis, made in experiments.items()
    }


def _errors(tracked: Any) -> dict[str, float]:
    return {
        "loop_width": tracked.loop_width,
        "tracking_rms": tracked.rms,
        "tracking_max": tracked.largest,
    }


def results_json(results: dict[str, Any]) -> bytes:
    """Write plain data, such as `study_results` gives, as indented JSON in UTF-8."""
    text = json.dumps(results, indent=2, ensure_ascii=False, allow_nan=False)
    return f"{text}\n".encode()


def _is_held(analysis: Analysis) -> bool:
    """Tell whether every body resists motion, so that loads have a static answer."""
    f = analysis.modes["removed"].frequency_hz
    return bool(f.size) and float(f[0]) > 1e-6 * float(f.max())


def _without_table(analysis: Analysis) -> dict[str, Any]:
    """All of an analysis but its characteristics, which stand in the table of the study."""
    results = analysis_results(analysis)
    del results["characteristics"]
    return results


def _finite(value: float | None) -> float | None:
    """JSON knows no infinity."""
    return None if value is None or not math.isfinite(value) else float(value)
