"""Sections of the report of a study on its models and on the virtual stage.

Equations, diagrams, stress and modes of meshes, their convergence; hysteresis, the simulated
measurement, a scale that was centred.
"""

import re
from collections.abc import Iterator, Mapping
from functools import partial
from typing import TYPE_CHECKING

from flexstage.base.errors import FlexstageError
from flexstage.quantities.characteristic import measured_value
from flexstage.quantities.quantity import display, number, value_and_uncertainty
from flexstage.quantities.section import Content, Picture, Pictures
from flexstage.quantities.table import Column, Table, table
from flexstage.report.figures.centring import draw_polar
from flexstage.report.figures.fields import draw_convergence, draw_fe_modes
from flexstage.report.figures.hinges import draw_neck_stress, neck_sampler
from flexstage.report.figures.tracking import draw_compensation
from flexstage.report.page import fragment
from flexstage.report.tables import full_stroke_words, published_loop
from flexstage.stage import PiezoStack, Stage
from flexstage.stage.assumptions import CREEP, POSITION_NOISE
from flexstage.studies.measurement import MeasurementComparison
from flexstage.studies.virtual_experiments import (
    ECCENTRICITY,
    HEAD_NOISE,
    HEADS,
    LINE_ERRORS,
    SCALE_RADIUS,
    CentringTrial,
)

if TYPE_CHECKING:
    from flexstage.hysteresis.loops import Tracking
    from flexstage.studies.compensation import AxisExperiment
    from flexstage.studies.models import ModelRun
    from flexstage.studies.study import Study


def equations_section(study: "Study") -> Iterator[Content]:
    """Say what the lumped model rests on, where the study has one."""
    if "lumped" in study.analyses:
        yield fragment("equations.html", order=study.analyses["lumped"].system.order)


def diagram_section(study: "Study") -> Iterator[Content]:
    """Show the structural diagram of each axis that one drive moves.

    Nothing where the study has no lumped model, or the stage no such axis.
    """
    named = [f"Axis {axis.name}" for axis in study.stage.axes if axis.drive is not None]
    if "lumped" not in study.analyses or not named:
        return
    try:
        drawings = [_inline(svg) for svg in study.diagrams().values()]
    except FlexstageError as error:
        yield f"No diagram could be drawn: {error}"
        return
    said = (
        "with the hysteresis that the experiment of this report identified"
        if study.experiments
        else "stacks with hysteresis of a usual width"
    )
    stacks = f", {said}" if any(isinstance(d, PiezoStack) for d in study.stage.drives) else ""
    found = _difference(study)
    captions = [f"{name}: lumped model{stacks}.{found and ' '}{found}" for name in named]
    axes = tuple(zip(drawings, captions, strict=True))
    yield fragment("diagrams.html", axes=axes)


def _difference(study: "Study") -> str:
    """Say by how much its frequencies are not those of the Bode diagrams."""
    if study.main.system.model == "lumped" or not study.main.axes:
        return ""
    pairs = [
        float(a.modes["in place"].frequency_hz[0]) for a in (study.analyses["lumped"], study.main)
    ]
    return (
        f"Its lowest natural frequency with the drives in place is {number(pairs[0])} Hz; the Bode "
        f"diagrams are of the {study.main.system.model} model, which has {number(pairs[1])} Hz."
    )


def _inline(svg: bytes) -> str:
    """Return what a drawing consists of, without what only a file of its own has."""
    text = re.sub(r"^\s*<\?xml[^>]*\?>\s*", "", svg.decode())
    # in a page a drawing needs no name of its format, and a page that names no address loads none
    return re.sub(r'\sxmlns="[^"]*"', "", text, count=1).replace("<svg", "", 1)


def neck_stress_section(study: "Study") -> Iterator[Content]:
    """Show the stress at the necks, by the model with a mesh that leaves the least out."""
    for name, run in _meshed(study):
        shown = [a for a in run.analysis.axes if any(a.static.hinge_stress.values())]
        if not shown:
            continue
        assert run.mesh is not None
        sampler = neck_sampler(run.mesh)
        where = ", middle plane" if run.mesh.system.model == "solid" else ""
        yield (
            "Displacements are magnified by the factor given; dashed: at rest. Identical necks "
            "are shown once; each close-up moves with its neck. The ring marks the largest stress "
            "on the surface of the notch; the title gives its value, its place at rest and the "
            "number of the hinge. Stress at held edges is in no figure of this chapter."
        )
        yield Pictures(
            pictures=tuple(
                Picture(
                    result=partial(
                        draw_neck_stress, run.mesh, run.analysis, axis.axis, sampler=sampler
                    ),
                    title=f"stress at the necks, {axis.axis}, model {name}",
                    caption=f"Equivalent stress (von Mises), {full_stroke_words(axis)}; "
                    f"{mesh_words(name, run)}{where}.",
                    size="small",
                )
                for axis in shown
            )
        )
        return


def fe_modes_section(study: "Study") -> Iterator[Content]:
    """Show the modes by the model with a mesh that leaves the least out."""
    for name, run in _meshed(study):
        if run.analysis.modes["removed"].frequency_hz.size:
            assert run.mesh is not None
            where = "" if name == "solid" else " in the plane"
            yield Picture(
                result=partial(draw_fe_modes, run.mesh, run.analysis),
                title=f"modes, model {name}",
                caption=f"Lowest modes{where}, drives removed; {mesh_words(name, run)}. Amplitudes "
                "are not to scale, so that bodies may overlap; thin: at rest.",
                size="small",
            )
            return


def convergence_section(study: "Study") -> Iterator[Content]:
    """Show how models settled as their meshes became finer, where one was refined."""
    shown = []
    for name, run in _meshed(study):
        found = run.refinement
        if found is None or len(found.steps) < 2:
            continue
        asked = display(found.quantity).label.lower()
        caption = (
            f"Change from mesh to mesh; {mesh_words(name, run)}. Requested: {asked} to "
            f"{100.0 * found.accuracy:.3g} %; estimate of the last mesh: "
            f"{100.0 * found.estimate:.2g} %. Stress is read at points on the notches and settles "
            "last."
        )
        title = f"convergence of model {name}"
        draw = partial(draw_convergence, found)
        shown.append(Picture(result=draw, title=title, caption=caption, size="small"))
    if shown:
        yield "Refinement cannot reveal errors common to all meshes: geometry, material, supports."
        yield Pictures(pictures=tuple(shown))


def mesh_words(name: str, run: "ModelRun") -> str:
    """Return a model with a mesh in a few words without a full stop."""
    mesh = run.mesh
    assert mesh is not None
    held = mesh.system.settings.get("held", "")
    unknowns = f"{mesh.unknowns:,}".replace(",", "\u00a0")
    return (
        f"model {name}, elements of order {mesh.mesh_settings.order}, {unknowns} unknowns, "
        f"{held or 'nothing is fixed'}"
    )


def _meshed(study: "Study") -> "Iterator[tuple[str, ModelRun]]":
    """Models with a mesh, the one that leaves the least out first."""
    for name in ("solid", "plane"):
        run = study.runs.get(name)
        if run is not None and run.mesh is not None:
            yield name, run


_UM = 1e6
#: Quantities of the simulated measurement that the report of a study shows.
_MAIN = (
    "output_displacement",
    "natural_frequency_hz",
    "straightness",
    "straightness_out_of_plane",
    "resolution",
    "noise",
    "drift",
    "hysteresis_loop_width",
)


def hysteresis_section(study: "Study") -> Iterator[Content]:
    """Show the experiment on hysteresis, with what is published of the stage.

    Nothing where no axis has a piezo stack.
    """
    if study.experiments:
        yield fragment("hysteresis.html", creep=100.0 * CREEP, noise=1e9 * POSITION_NOISE)
        yield _deviations(study.stage, study.experiments)
        yield _loops(study.stage, study.experiments)
        shown = Picture(
            result=partial(draw_compensation, study.experiments),
            title="loops without and with the inverse",
            caption="Simulated stage. Left: loop over the full range of the voltage and the "
            "identified Bouc-Wen model, below their difference. Middle: output over the reference. "
            "Right: error over time.",
        )
        yield Pictures(pictures=(shown,))
    for axis, why in study.skipped_experiments.items():
        yield f"Axis {axis} was left out: {why}."


def _deviations(stage: Stage, experiments: "Mapping[str, AxisExperiment]") -> str:
    words = []
    for axis, made in experiments.items():
        published = measured_value(stage.published, "hysteresis_deviation", axis)
        printed = "" if published is None else f" (published: {_UM * published:.10g} µm)"
        words.append(f"{_UM * made.deviation:.2f} µm in {axis}{printed}")
    return f"The identified Bouc-Wen model is within {', '.join(words)} of the loop."


def _loops(stage: Stage, experiments: "Mapping[str, AxisExperiment]") -> Table:
    rows = []
    for axis, made in experiments.items():
        rows.append(_loop(f"{axis}, open loop", made.open_loop.loop_width, None, made.open_loop))
        rows += [
            _loop(
                f"{axis}, inverse of {run.title}",
                run.tracking.loop_width,
                run.reduction_percent,
                run.tracking,
            )
            for run in made.runs
        ]
        width, left, reduction = published_loop(stage.published, axis)
        if width is not None:
            rows.append(_loop(f"{axis}, published, open loop", width, None, None))
        if left is not None and reduction is not None:
            title = f"{axis}, published, inverse of Bouc-Wen"
            rows.append(_loop(title, left, reduction, None))
    heads = (
        Column("", "title"), "loop width [µm]", "narrowed by [%]", "error [nm rms]",
        "largest error [nm]",
    )  # fmt: skip
    caption = (
        "Loop widths and errors over the reference, which runs over 99 % of the stroke; the loop "
        "at full range is a little wider. Published rows were measured by the study."
    )
    return table(caption, heads, rows)


def _loop(
    title: str, width: float, reduction: float | None, errors: "Tracking | None"
) -> tuple[str, ...]:
    return (
        title,
        f"{_UM * width:.2f}",
        "" if reduction is None else f"{reduction:.1f}",
        "" if errors is None else number(1e3 * _UM * errors.rms, 3),
        "" if errors is None else number(1e3 * _UM * errors.largest, 3),
    )


def bench_section(found: MeasurementComparison | str | None, file: str) -> Iterator[Content]:
    """Show half a page on the simulated measurement, where there is one.

    The file is the name of the page that it has of its own, beside this one.
    """
    if isinstance(found, str):
        yield f"The virtual stage could not be measured: {found}."
    elif found is not None:
        yield fragment("bench.html", file=file)
        yield from _main_figures(found)
        yield Pictures(pictures=tuple(_resonances(found)), columns=2)


def _main_figures(found: MeasurementComparison) -> Iterator[Table]:
    """A row for each main quantity, a column for each axis."""
    main = [row for row in found.rows if row.figure.quantity in _MAIN]
    figures = [row.figure for row in main if not row.assumed]
    axes = list(dict.fromkeys(figure.axis for figure in figures))
    rows = []
    for quantity in _MAIN:
        of = {f.axis: f.estimate for f in figures if f.quantity == quantity}
        if of:
            shown = display(quantity).fitting(max(abs(e.value) for e in of.values()))
            k = shown.factor
            values = (
                " ± ".join(value_and_uncertainty(k * of[a].value, k * of[a].expanded))
                if a in of
                else "–"
                for a in axes
            )
            rows.append((shown.heading, *values))
    if rows:
        caption = "Simulated measurement: main figures, ± at 95 % with all contributions."
        if len(figures) < len(main):
            caption += " Straightness that nobody has measured is assumed, and left out."
        yield table(caption, ("Quantity", *(Column(axis) for axis in axes)), rows)


def _resonances(found: MeasurementComparison) -> Iterator[Picture]:
    published = () if found.stage is None else found.stage.published
    estimates = {(r.figure.quantity, r.figure.axis): r.figure.estimate for r in found.rows}
    for result in found.characterisation.results:
        fit = result.details.get("fit")
        if fit is None or not fit.modes:
            continue
        axis = result.test.axis
        known = measured_value(published, "natural_frequency_hz", axis)
        agree = (
            " The simulated stage is set to the published value, so that both agree."
            if known is not None
            else ""
        )
        yield Picture(
            result=fit,
            view="resonance",
            title=f"resonance of {axis}",
            caption=f"Response of {axis}, simulated measurement.{agree}",
            options={
                "axis": axis,
                "label": "simulated measurement",
                "frequency_hz": estimates.get(("natural_frequency_hz", axis)),
                "published_hz": known,
            },
        )


def centring_section(found: CentringTrial | str | None) -> Iterator[Content]:
    """Show the scale that was centred, where that was asked for."""
    if found is None:
        return
    if isinstance(found, str):
        yield f"No scale could be centred: {found}."
        return
    procedure = found.procedure
    rows = []
    for count, step in enumerate(procedure.steps):
        length = step.reading.length
        low, high = length.interval()
        expected = "" if step.predicted is None else f"{step.predicted.interval()[1] * 1e6:.3f}"
        places = (f"{value * 1e6:.3f}" for value in (*step.command, length.value))
        between = f"{low * 1e6:.3f} to {high * 1e6:.3f}"
        rows.append((count, step.kind, *places, between, expected))
    target = "met" if procedure.reached else "not met"
    yield (
        f"A scale of {2e3 * SCALE_RADIUS:g} mm diameter, {ECCENTRICITY * 1e6:g} µm off the axis of "
        f"a virtual table, read by {len(HEADS)} heads with {HEAD_NOISE:g} arcsec of noise; its own "
        f"lines are off by {LINE_ERRORS:g} arcsec (rms). The stage turns with the table, mounted "
        "at an unknown angle and mirrored, which trial moves find out. Each command is approached "
        f"from the low end of both axes. True residual eccentricity: {found.residual * 1e9:.2g} nm "
        f"(target {target}: {procedure.reason})."
    )
    heads = (
        "", "step", "x [µm]", "y [µm]", "eccentricity [µm]", "95 % interval", "predicted, at most",
    )  # fmt: skip
    yield table("Centring step by step; simulated.", heads, rows)
    words = "Graduation error read by the first head before and after centring; simulated."
    draw = partial(draw_polar, found.fits, found.angles)
    yield Pictures(pictures=(Picture(result=draw, title="scale before and after", caption=words),))
