"""A study as plain data: what `results.json` holds, as `results.schema.json` describes it."""

from typing import TYPE_CHECKING, Any

from flexstage.characteristic import Characteristic
from flexstage.files.plain import json_text, picked, plain
from flexstage.studies.models import ModelRun
from flexstage.system import Analysis, Modes, load_readings
from flexstage.system.coupled_axes import CoupledAxes

if TYPE_CHECKING:
    from collections.abc import Mapping

    from flexstage.studies.compensation import AxisExperiment
    from flexstage.studies.measurement import MeasurementComparison
    from flexstage.studies.study import Study
    from flexstage.studies.traditional import TraditionalComparison
    from flexstage.studies.virtual_experiments import CentringTrial


def characteristic_row(row: Characteristic) -> dict[str, Any]:
    """Return a characteristic as a row of the tidy table, with the criterion that it fails."""
    named = ("quantity", "axis", "origin", "value", "unit", "uncertainty", "note", "failing")
    return picked(row, *named)


def analysis_results(analysis: Analysis, *, responses: bool = False) -> dict[str, Any]:
    """Return an analysis as plain data; SI units, frequencies in Hz.

    With the motion of the probes under one unit of each load on the whole stage [m]; the frequency
    responses, which are long, where asked for.
    """
    readings = load_readings(analysis.system) if _is_held(analysis) else {}
    out: dict[str, Any] = {
        "model": analysis.system.model,
        "characteristics": [characteristic_row(row) for row in analysis.characteristics],
        "modes": {condition: _mode_rows(found) for condition, found in analysis.modes.items()},
        **picked(analysis, "hinge_stress"),
        "loads": {
            load.name: {"unit": load.unit, "readings": readings[load.name]}
            for load in analysis.system.loads
            if load.name in readings
        },
        **picked(analysis, "validity", "provenance"),
    }
    if analysis.coupling is not None:
        out["coupling"] = coupling_results(analysis.coupling)
    if responses:
        out["responses"] = [
            picked(
                response,
                "drive",
                "probe",
                "drives",
                "input=input_kind",
                "unit",
                "frequency_hz",
                "real=value.real",
                "imaginary=value.imag",
            )
            for response in analysis.responses
        ]
    return out


def _mode_rows(found: Modes) -> list[dict[str, Any]]:
    """Return modes as plain data, with the estimate of the error of each frequency if there is."""
    rows = [
        {"natural_frequency_hz": plain(f), "damping_ratio": plain(zeta)}
        for f, zeta in zip(found.frequency_hz, found.damping_ratio, strict=True)
    ]
    if found.uncertainty_hz is not None:
        for row, u in zip(rows, found.uncertainty_hz, strict=True):
            row["uncertainty_hz"] = plain(u)
    return rows


def coupling_results(found: CoupledAxes) -> dict[str, Any]:
    """Return what all drives do to all axes as plain data, in SI units.

    Rows of the Jacobian are axes and its columns drives; of the decoupling matrix, which is None
    where the drives cannot move one axis alone, it is the other way round.
    """
    reached = found.workspace
    return {
        **picked(
            found,
            "axes=names",
            "units",
            "drives",
            "strokes",
            "jacobian",
            "characteristic_length=length",
            "singular_values",
            "condition_number",
            "isotropy",
            "manipulability",
            "coupled",
        ),
        "decoupling": plain(found.decoupling) if found.independent else None,
        "workspace": None
        if reached is None
        else {
            **picked(reached, "axes", "middle", "area", "projected_area", "volume"),
            "outline": plain(reached.section()),
            "projection": plain(reached.projection),
        },
    }


def run_results(run: ModelRun) -> dict[str, Any]:
    """Return what a run has beyond its analysis, as plain data; SI units, frequencies in Hz.

    Only what there is of the meshes and their values, the path of each axis, and the buckling load
    of bars [N].
    """
    out: dict[str, Any] = {}
    if run.refinement is not None:
        out["refinement"] = {
            **picked(run.refinement, "quantity", "accuracy", "estimate"),
            "steps": [
                {
                    **picked(step.settings, "order", "neck_size"),
                    "unknowns": step.unknowns,
                    "seconds": round(step.seconds, 3),
                    "values": [
                        {"quantity": quantity, "axis": axis, "value": plain(value)}
                        for (quantity, axis), value in step.values.items()
                    ],
                }
                for step in run.refinement.steps
            ],
        }
    if run.strokes:
        out["strokes"] = {
            path.axis: picked(
                path,
                "displacement",
                "force",
                "along",
                "across",
                "rotation",
                "natural_frequency_hz_at_full_stroke=frequency_hz",
                "ratio_change",
            )
            for path in run.strokes
        }
    if run.bars:
        out["bar_buckling_load"] = plain(run.bars)
    return out


def model_data(run: ModelRun) -> dict[str, Any]:
    """Return all that one model found as plain data, with its frequency responses."""
    return analysis_results(run.analysis, responses=True) | run_results(run)


def study_data(study: "Study") -> dict[str, Any]:
    """Return a study as plain data.

    The tidy table of characteristics, and each model's modes, stress, validity, provenance.
    """
    stage = study.stage
    return {
        **picked(stage, "stage=name", "title", "notes"),
        "characteristics": [characteristic_row(row) for row in study.characteristics],
        "models": {
            name: _without_table(a) | run_results(study.runs.get(name, ModelRun(analysis=a)))
            for name, a in study.analyses.items()
        },
        "left_out": dict(study.left_out),
        "hysteresis": experiment_results(study.experiments),
        "virtual_measurement": _virtual(study.virtual),
        "centring": centring_results(study.centring),
        "traditional": traditional_results(study.traditional),
        "variants": {name: analysis_results(a) for name, a in study.variants.items()},
    }


def _virtual(found: "MeasurementComparison | str | None") -> dict[str, Any]:
    if found is None:
        return {}
    return {"reason": found} if isinstance(found, str) else found.to_dict()


def centring_results(found: "CentringTrial | str | None") -> dict[str, Any]:
    """Return what is left of the eccentricity [m] and every step as plain data; or why not."""
    if found is None:
        return {}
    if isinstance(found, str):
        return {"reason": found}
    return {
        "kind": "virtual experiment",
        **picked(found, "left", "reached=done.reached", "reason=done.reason"),
        "steps": [
            {
                **picked(step, "kind", "command"),
                **picked(step.reading.length, "length=value", "interval"),
                "predicted": None if step.predicted is None else step.predicted.value,
            }
            for step in found.done.steps
        ],
    }


def traditional_results(found: "TraditionalComparison | None") -> dict[str, Any]:
    """Return the comparison with traditional stages as plain data; SI units, shares from 0 to 1.

    Motion errors are medians and 95 % quantiles of the samples.
    """
    if found is None:
        return {}
    from flexstage.studies.traditional import MEASURES, drift_verdict, verdict

    stages = (found.own, *found.others, found.asymmetric)
    return {
        **picked(found, "claim", "samples", "measured", "implied", "longest_leg", "scatter"),
        "stages": [
            {
                **picked(stage, "title", "frequency_hz", "size", "mass", "actuators"),
                "drift": {
                    load: dict(zip(("x", "y", "rotation"), moved, strict=True))
                    for load, moved in stage.drift.items()
                },
                "axes": {
                    name: {
                        **picked(axis, "travel", "geometry", "bending", "manufacture"),
                        **picked(axis, "assembly", "coupling", "finite_elements"),
                        **{
                            what: dict(zip(("median", "upper"), axis.figures(what), strict=True))
                            for what in ("across", "straightness", "normal", "yaw", "tilt")
                        },
                    }
                    for name, axis in stage.axes.items()
                },
            }
            for stage in stages
        ],
        "catalogue": plain(found.catalogue),
        "reductions": {
            measure: [
                picked(row, "against", "other", "reduction", "share", "holds")
                for row in found.reductions(measure)
            ]
            for measure in MEASURES
        },
        "verdict": [*verdict(found), *drift_verdict(found)],
    }


def experiment_results(experiments: "Mapping[str, AxisExperiment]") -> dict[str, Any]:
    """Return the figures of the experiments as plain data, by axis.

    Stroke, widths, errors [m], reductions [%], and how good each model is [%].
    """
    return {
        axis: {
            "kind": "virtual experiment",
            **picked(made, "stroke", "loop_width=width", "model_deviation=deviation"),
            "open_loop": _errors(made.open_loop),
            "runs": [
                {
                    **picked(
                        run.identification, "model=kind", "rms_percent", "heldout_rms_percent"
                    ),
                    "reduction_percent": run.reduction_percent,
                    **_errors(run.tracking),
                }
                for run in made.runs
            ],
        }
        for axis, made in experiments.items()
    }


def _errors(tracked: Any) -> dict[str, float]:
    return picked(tracked, "loop_width", "tracking_rms=rms", "tracking_max=largest")


def results_json(results: dict[str, Any]) -> bytes:
    """Write plain data, such as `Study.to_dict` gives, as indented JSON in UTF-8."""
    return json_text(results).encode()


def _is_held(analysis: Analysis) -> bool:
    """Tell whether every body resists motion, so that loads have a static answer."""
    f = analysis.modes["removed"].frequency_hz
    return bool(f.size) and float(f[0]) > 1e-6 * float(f.max())


def _without_table(analysis: Analysis) -> dict[str, Any]:
    """All of an analysis but its characteristics, which stand in the table of the study."""
    results = analysis_results(analysis)
    del results["characteristics"]
    return results
