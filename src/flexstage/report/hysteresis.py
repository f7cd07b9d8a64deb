"""The section on hysteresis: the experiment of a study on the virtual stage."""

from collections.abc import Mapping
from html import escape
from typing import TYPE_CHECKING, Any

from flexstage.characteristic import measured_value
from flexstage.quantities import number
from flexstage.report.figures.tracking import draw_compensation
from flexstage.report.page import captioned, cells, drawn, row_of, table_html
from flexstage.stage import Stage

if TYPE_CHECKING:
    from flexstage.studies.compensation import AxisExperiment
    from flexstage.studies.study import Study

_UM = 1e6
_CAPTION = (
    "Simulated stage. Left: loop over the full range of the voltage and the identified Bouc-Wen "
    "model, below their difference. Middle: output over the reference. Right: error over time."
)


def hysteresis_section(study: "Study") -> str:
    """Write the section, with what is published of the stage.

    Empty where no axis has a piezo stack.
    """
    stage, experiments = study.stage, study.experiments
    reasons = "".join(
        f"<p>Axis {escape(axis)} was left out: {escape(why)}.</p>"
        for axis, why in study.experiments_left_out.items()
    )
    if not experiments:
        return reasons
    plot = draw_compensation(experiments)
    return (
        "<p>An experiment on the <em>virtual</em> stage, the entire dynamic model: amplifier, "
        "stacks with hysteresis, creep of 1.2 % per decade, all modes with the stacks in place, a "
        "sensor with 5 nm of noise. The simulated stack obeys a law outside the classes being "
        "fitted. Its stroke and loop width are set to the published measurement, where there is "
        "one. Bouc-Wen is identified from full and falling loops at 1 Hz, the other model from a "
        "designed record at two rates. The loop width hides every error that both branches share; "
        "therefore the error from the reference is given as well.</p>"
        f"<p>{_deviations(stage, experiments)}</p>{_table(stage, experiments)}"
        + row_of([drawn(plot, "hysteresis", "loops without and with the inverse", _CAPTION)])
        + reasons
    )


def _deviations(stage: Stage, experiments: "Mapping[str, AxisExperiment]") -> str:
    words = []
    for axis, made in experiments.items():
        published = measured_value(stage.published, "hysteresis_deviation", axis)
        beside = "" if published is None else f" (published: {_UM * published:.10g} µm)"
        words.append(f"{_UM * made.deviation:.2f} µm in {escape(axis)}{beside}")
    return f"The identified Bouc-Wen model is within {', '.join(words)} of the loop."


def _table(stage: Stage, experiments: "Mapping[str, AxisExperiment]") -> str:
    head = ("", "loop width [µm]", "narrowed by [%]", "error [nm rms]", "largest error [nm]")
    rows = []
    for axis, made in experiments.items():
        name = escape(axis)
        rows.append(_row(f"{name}, open loop", made.open_loop.loop_width, None, made.open_loop))
        rows += [
            _row(
                f"{name}, inverse of {escape(run.title)}",
                run.tracking.loop_width,
                run.reduction_percent,
                run.tracking,
            )
            for run in made.runs
        ]
        open_width = measured_value(stage.published, "hysteresis_loop_width", axis)
        left = measured_value(stage.published, "compensated_loop_width", axis)
        if open_width is not None:
            rows.append(_row(f"{name}, published, open loop", open_width, None, None))
        if open_width is not None and left is not None:
            reduction = 100.0 * (1.0 - left / open_width)
            rows.append(_row(f"{name}, published, inverse of Bouc-Wen", left, reduction, None))
    caption = (
        "Loop widths and errors over the reference, which runs over 99 % of the stroke; the loop "
        "at full range is a little wider. Published rows were measured by the study."
    )
    return captioned(table_html((f"<th>{title}</th>" for title in head), rows), caption)


def _row(title: str, width: float, reduction: float | None, errors: Any) -> str:
    values = [
        f"{_UM * width:.2f}",
        "" if reduction is None else f"{reduction:.1f}",
        "" if errors is None else number(1e3 * _UM * errors.rms, 3),
        "" if errors is None else number(1e3 * _UM * errors.largest, 3),
    ]
    return f"<tr><th>{title}</th>{cells(values)}</tr>"
