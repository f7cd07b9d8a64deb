"""Experiments on the virtual stage that a study shows: it is measured, and centres a scale."""

from dataclasses import dataclass
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from flexstage.characteristic import Characteristics
from flexstage.errors import FlexstageError
from flexstage.report.figures import draw_polar, inline_svg
from flexstage.report.measurement import Measurement, set_beside
from flexstage.report.measurement_html import measurement_section
from flexstage.report.quantities import number

if TYPE_CHECKING:
    from flexstage.centring import HarmonicFit
    from flexstage.centring.procedure import Centring
    from flexstage.stage import Stage

__all__ = [
    "CentringTrial",
    "bench_section",
    "centring_results",
    "centring_section",
    "run_centring",
    "run_measurement",
]

Array = NDArray[np.float64]

#: The scale that is centred: where it is read [m], how far it is off at first [m], and its heads.
_RADIUS, _OFF = 50e-3, 50e-6
_HEADS = (0.0, 1.6, 3.1, 4.8)
#: Noise of a head, and errors of the lines of the scale [arcsec].
_NOISE, _LINES = 1.0, 2.0
#: Direction that the scale is off in, in the axes of the stage: one that both can push [rad].
_DIRECTION = 0.8


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CentringTrial:
    """A scale that was centred on the virtual table.

    Parameters
    ----------
    done : Centring
        The procedure, step by step.
    left : float
        Eccentricity that is truly left [m].
    fits : tuple of HarmonicFit
        Readings of the first head before and after.
    angles : tuple of numpy.ndarray
        Angles of their samples [rad].
    """

    done: "Centring"
    left: float
    fits: "tuple[HarmonicFit, HarmonicFit]"
    angles: tuple[Array, Array]


def run_measurement(stage: "Stage", references: Characteristics, *, seed: int) -> Measurement | str:
    """Measure a virtual stage, and compare.

    Parameters
    ----------
    stage : Stage
        The stage.
    references : Characteristics
        Rows of models and publications.
    seed : int
        Seed of the virtual stage and of its measurement.

    Returns
    -------
    Measurement or str
        The figures; or why there are none.
    """
    from flexstage.experiment.campaign import evaluate
    from flexstage.experiment.virtual import as_built, virtual_campaign

    try:
        made = virtual_campaign(as_built(stage, seed=seed), seed=seed)
        found = evaluate(made.campaign, lambda test: [made.records[n] for n in test.records])
    except FlexstageError as error:
        return str(error)
    return set_beside(found, stage, references)


def run_centring(stage: "Stage", *, seed: int) -> CentringTrial | str:
    """Centre a scale with the virtual stage on a virtual table.

    Parameters
    ----------
    stage : Stage
        The stage.
    seed : int
        Seed of noise and of the lines of the scale.

    Returns
    -------
    CentringTrial or str
        How it went; or why it could not be tried.
    """
    from flexstage.centring import ARCSEC, fit_harmonics
    from flexstage.centring.bench import VirtualBench
    from flexstage.centring.positioner import VirtualPositioner
    from flexstage.centring.procedure import centre
    from flexstage.centring.virtual_table import VirtualTable, scale_errors

    try:
        positioner = VirtualPositioner(
            stage, start=(-1.0, -1.0), mounting_angle=0.7, mirrored=True, seed=seed
        )
        towards = positioner.matrix @ np.array((np.cos(_DIRECTION), np.sin(_DIRECTION)))
        mount = -_OFF * towards / np.hypot(*towards) - positioner.true_position
        table = VirtualTable(
            radius=_RADIUS,
            heads=_HEADS,
            eccentricity=(float(mount[0]), float(mount[1])),
            noise=_NOISE * ARCSEC,
            scale=scale_errors(range(2, 20), _LINES * ARCSEC, seed=seed),
            seed=seed,
        )
        bench = VirtualBench(table, positioner)

        def turn(index: int) -> tuple[Array, Any]:
            x, y = positioner.true_position
            record = table.moved(float(x), float(y)).record(index=index)
            angle, error = (channel.values for channel in record.channels[:2])
            return angle, fit_harmonics(angle, error, orders=12)

        before = turn(1000)
        done = centre(bench, positioner)
        after = turn(1001)
    except FlexstageError as error:
        return str(error)
    return CentringTrial(
        done=done,
        left=float(np.hypot(*bench.true_eccentricity)),
        fits=(before[1], after[1]),
        angles=(before[0], after[0]),
    )


def bench_section(found: Measurement | str | None) -> str:
    """Write the section on the virtual measurement.

    Parameters
    ----------
    found : Measurement or str or None
        What it gave, or why it could not be done.

    Returns
    -------
    str
        HTML; empty where it was not asked for.
    """
    if found is None:
        return ""
    if isinstance(found, str):
        return f"<p>The virtual stage could not be measured: {escape(found)}.</p>"
    return (
        "<p>A stage is made with the scatter of a machine, read by sensors whose gain, direction, "
        "drift and noise are drawn as they are stated, and its records are evaluated as measured "
        "ones are. Nothing here was measured.</p>" + measurement_section(found, prefix="virtual-")
    )


def centring_section(found: CentringTrial | str | None) -> str:
    """Write the section on the scale that was centred.

    Parameters
    ----------
    found : CentringTrial or str or None
        How it went, or why it could not be tried.

    Returns
    -------
    str
        HTML; empty where it was not asked for.
    """
    if found is None:
        return ""
    if isinstance(found, str):
        return f"<p>No scale could be centred: {escape(found)}.</p>"
    done = found.done
    rows = []
    for number_of, step in enumerate(done.steps):
        length = step.reading.length
        low, high = length.interval()
        expected = "" if step.predicted is None else f"{step.predicted.interval()[1] * 1e6:.3f}"
        rows.append(
            f"<tr><td>{number_of}</td><td>{step.kind}</td>"
            f"<td>{step.command[0] * 1e6:.3f}</td><td>{step.command[1] * 1e6:.3f}</td>"
            f"<td>{length.value * 1e6:.3f}</td><td>{low * 1e6:.3f} to {high * 1e6:.3f}</td>"
            f"<td>{expected}</td></tr>".replace(">-", ">−")
        )
    heads = "".join(
        f"<th>{title}</th>"
        for title in (
            "",
            "step",
            "x [µm]",
            "y [µm]",
            "eccentricity [µm]",
            "95 % interval",
            "predicted, at most",
        )
    )
    svg = inline_svg(draw_polar(found.fits, found.angles), "centring", "scale before and after")
    return (
        f"<p>A scale of {2e3 * _RADIUS:g} mm diameter, {_OFF * 1e6:g} µm off the axis of a "
        f"virtual table, read by {len(_HEADS)} heads with {_NOISE:g} arcsec of noise; its own "
        f"lines are off by {_LINES:g} arcsec (rms). The stage turns with the table, mounted at an "
        "angle and the wrong way round, which trial moves find out. Each command is approached "
        "from the low end of both axes. "
        f"Truly left: {number(found.left * 1e6, 3)} µm; {escape(done.reason)}.</p>"
        f'<div class="scroll"><table><thead><tr>{heads}</tr></thead>'
        f"<tbody>{''.join(rows)}</tbody></table></div>"
        f'<div class="plots">{svg}</div>'
    )


def centring_results(found: CentringTrial | str | None) -> dict[str, Any]:
    """Return the scale that was centred as plain data.

    Parameters
    ----------
    found : CentringTrial or str or None
        How it went, or why it could not be tried.

    Returns
    -------
    dict
        What is left [m], and every step; the reason where there is none.
    """
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
