"""Sections of the report of a study on its models and on the simulated stage.

Equations, diagrams, stress and modes of meshes, their convergence; hysteresis, the simulated
measurement, the centring of a scale.
"""

import re
from collections.abc import Iterator, Mapping
from functools import partial
from typing import TYPE_CHECKING

from flexstage.base.errors import FlexstageError
from flexstage.quantities.characteristic import measured_value
from flexstage.quantities.quantity import display, number, value_and_uncertainty
from flexstage.quantities.table import Column, Content, Picture, Pictures, Table, table
from flexstage.report.figures.centring import draw_polar
from flexstage.report.figures.fields import draw_convergence, draw_fe_modes
from flexstage.report.figures.hinges import draw_neck_stress, neck_sampler
from flexstage.report.figures.tracking import draw_compensation
from flexstage.report.page import fragment
from flexstage.report.tables import (
    full_stroke_words,
    published_loop,
    rms_rows,
    rms_unit,
    tree_table,
)
from flexstage.stage import PiezoStack, Stage
from flexstage.stage.assumptions import CREEP, POSITION_NOISE
from flexstage.studies.measurement import MeasurementComparison
from flexstage.studies.requests import StudyRequest
from flexstage.studies.virtual_experiments import (
    ECCENTRICITY,
    HEAD_NOISE,
    HEADS,
    LINE_ERRORS,
    SCALE_RADIUS,
    CentringTrial,
)

if TYPE_CHECKING:
    from flexstage.control.dynamic_budget import PointBudget
    from flexstage.hysteresis.loops import Tracking
    from flexstage.studies.compensation import AxisExperiment
    from flexstage.studies.models import ModelRun
    from flexstage.studies.study import Study


def equations_section(study: "Study") -> Iterator[Content]:
    """Yield the equations of the lumped model, if the study has one."""
    if "lumped" in study.analyses:
        yield fragment("equations.html", order=study.analyses["lumped"].system.order)


def diagram_section(study: "Study") -> Iterator[Content]:
    """Yield the structural diagram of each axis with a drive of its own.

    It is empty without a lumped model or such an axis.
    """
    axis_names = [f"Axis {axis.name}" for axis in study.stage.axes if axis.drive is not None]
    if "lumped" not in study.analyses or not axis_names:
        return
    try:
        drawings = [_inline(svg) for svg in study.diagrams().values()]
    except FlexstageError as error:
        yield f"No diagram could be drawn: {error}"
        return
    origin = (
        "with the hysteresis identified in this report"
        if study.experiments
        else "stacks with a typical hysteresis width"
    )
    stacks = f", {origin}" if any(isinstance(d, PiezoStack) for d in study.stage.drives) else ""
    difference = _difference(study)
    captions = [
        f"{name}: lumped model{stacks}.{difference and ' '}{difference}" for name in axis_names
    ]
    axes = tuple(zip(drawings, captions, strict=True))
    yield fragment("diagrams.html", axes=axes)


def _difference(study: "Study") -> str:
    """Return a sentence on the difference of its frequencies from those of the Bode diagrams."""
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
    """Return the content of a drawing, without the parts of a separate file."""
    text = re.sub(r"^\s*<\?xml[^>]*\?>\s*", "", svg.decode())
    # inline SVG needs no namespace, and the page contains no address
    return re.sub(r'\sxmlns="[^"]*"', "", text, count=1).replace("<svg", "", 1)


def neck_stress_section(study: "Study") -> Iterator[Content]:
    """Yield the stress at the necks, by the most complete model with a mesh."""
    for name, run in _meshed(study):
        axes = [a for a in run.analysis.axes if any(a.static.hinge_stress.values())]
        if not axes:
            continue
        assert run.mesh is not None
        sampler = neck_sampler(run.mesh)
        where = ", middle plane" if run.mesh.system.model == "solid" else ""
        yield (
            "Displacements are magnified by the factor given; dashed: at rest. Identical necks "
            "are shown once; each close-up moves with its neck. The ring marks the largest stress "
            "on the surface of the notch; the title gives its value, its position at rest and the "
            "number of the hinge. This chapter excludes the stress at fixed edges."
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
                for axis in axes
            )
        )
        return


def fe_modes_section(study: "Study") -> Iterator[Content]:
    """Yield the modes by the most complete model with a mesh."""
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
    """Yield the mesh convergence of each refined model."""
    pictures = []
    for name, run in _meshed(study):
        refinement = run.refinement
        if refinement is None or len(refinement.steps) < 2:
            continue
        quantity = display(refinement.quantity).label.lower()
        caption = (
            f"Mesh convergence; {mesh_words(name, run)}. Requested: {quantity} to "
            f"{100.0 * refinement.accuracy:.3g} %; estimated error of the last mesh: "
            f"{100.0 * refinement.estimate:.2g} %. Stress is evaluated at points on the notches "
            "and converges last."
        )
        title = f"convergence of model {name}"
        draw = partial(draw_convergence, refinement)
        pictures.append(Picture(result=draw, title=title, caption=caption, size="small"))
    if pictures:
        yield "Refinement cannot reveal errors common to all meshes: geometry, material, supports."
        yield Pictures(pictures=tuple(pictures))


def mesh_words(name: str, run: "ModelRun") -> str:
    """Return a short description of a model with a mesh, without a full stop."""
    mesh = run.mesh
    assert mesh is not None
    supports = mesh.system.settings.get("held", "")
    unknowns = f"{mesh.unknowns:,}".replace(",", "\u00a0")
    return (
        f"model {name}, elements of order {mesh.mesh_settings.order}, {unknowns} unknowns, "
        f"{supports or 'no supports'}"
    )


def _meshed(study: "Study") -> "Iterator[tuple[str, ModelRun]]":
    """Yield the models with a mesh, the most complete one first."""
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
    """Yield the hysteresis experiment, with published values of the stage.

    It is empty if no axis has a piezo stack.
    """
    if study.experiments:
        yield fragment("hysteresis.html", creep=100.0 * CREEP, noise=1e9 * POSITION_NOISE)
        yield _deviations(study.stage, study.experiments)
        yield _loops(study.stage, study.experiments)
        picture = Picture(
            result=partial(draw_compensation, study.experiments),
            title="loops without and with the inverse",
            caption="Simulated stage. Left: loop over the full range of the voltage with the "
            "identified Bouc-Wen model; below: their difference. Middle: output over the "
            "reference. Right: error over time.",
        )
        yield Pictures(pictures=(picture,))
    for axis, why in study.skipped_experiments.items():
        yield f"Axis {axis} was skipped: {why}."


def _deviations(stage: Stage, experiments: "Mapping[str, AxisExperiment]") -> str:
    words, printed = [], []
    for axis, experiment in experiments.items():
        published = measured_value(stage.published, "hysteresis_deviation", axis)
        printed += [] if published is None else [f"{_UM * published:.10g} µm in {axis}"]
        words.append(f"{_UM * experiment.deviation:.2f} µm in {axis}")
    sentence = "Largest deviation of the identified Bouc-Wen model from the loop"
    measured = f" Published, measured on the real stage: {', '.join(printed)}." if printed else ""
    return f"{sentence}, simulated: {', '.join(words)}.{measured}"


def _loops(stage: Stage, experiments: "Mapping[str, AxisExperiment]") -> Table:
    rows = []
    for axis, experiment in experiments.items():
        rows.append(
            _loop(f"{axis}, open loop", experiment.open_loop.loop_width, None, experiment.open_loop)
        )
        rows += [
            _loop(
                f"{axis}, inverse of {run.title}",
                run.tracking.loop_width,
                run.reduction_percent,
                run.tracking,
            )
            for run in experiment.runs
        ]
    for axis in experiments:
        width, compensated_width, reduction = published_loop(stage.published, axis)
        if width is not None:
            rows.append(_loop(f"{axis}, published, open loop", width, None, None))
        if compensated_width is not None and reduction is not None:
            title = f"{axis}, published, inverse of Bouc-Wen"
            rows.append(_loop(title, compensated_width, reduction, None))
    heads = (
        Column("", "title"), "<kind", "loop width [µm]", "reduction [%]", "error [nm rms]",
        "largest error [nm]",
    )  # fmt: skip
    caption = (
        "Loop widths and errors for a reference over 99 % of the stroke; the loop over the full "
        "range is slightly wider. The published rows are of real stacks: a simulation neither "
        "confirms nor contradicts them."
    )
    return table(caption, heads, rows)


def _loop(
    title: str, width: float, reduction: float | None, errors: "Tracking | None"
) -> tuple[str, ...]:
    return (
        title,
        "measured" if errors is None else "simulated",
        f"{_UM * width:.2f}",
        "" if reduction is None else f"{reduction:.1f}",
        "" if errors is None else number(1e3 * _UM * errors.rms, 3),
        "" if errors is None else number(1e3 * _UM * errors.largest, 3),
    )


def bench_section(measurement: MeasurementComparison | str | None, file: str) -> Iterator[Content]:
    """Yield half a page on the simulated measurement, if there is one.

    The file is the name of its own page in the same folder.
    """
    if isinstance(measurement, str):
        yield f"The simulated stage could not be measured: {measurement}."
    elif measurement is not None:
        yield fragment("bench.html", file=file)
        yield from _main_figures(measurement)
        yield Pictures(pictures=tuple(_resonances(measurement)), columns=2)


def _main_figures(measurement: MeasurementComparison) -> Iterator[Table]:
    """Yield a table with a row for each main quantity, a column for each axis."""
    main = [row for row in measurement.rows if row.figure.quantity in _MAIN]
    axes = list(dict.fromkeys(row.figure.axis for row in main))
    rows = []
    for quantity in _MAIN:
        of_quantity = [row for row in main if row.figure.quantity == quantity]
        of = {row.figure.axis: row.figure.estimate for row in of_quantity}
        if of:
            quantity_shown = display(quantity).fitting(max(abs(e.value) for e in of.values()))
            k = quantity_shown.factor
            values = (
                " ± ".join(value_and_uncertainty(k * of[a].value, k * of[a].expanded))
                if a in of
                else "–"
                for a in axes
            )
            sources = "; ".join(dict.fromkeys(row.source for row in of_quantity))
            rows.append((quantity_shown.heading, *values, sources))
    if rows:
        caption = "Simulated measurement: main figures, ± at 95 % with all contributions."
        heads = ("Quantity", *(Column(axis) for axis in axes), Column("source", "words"))
        yield table(caption, heads, rows)


def _resonances(measurement: MeasurementComparison) -> Iterator[Picture]:
    published = () if measurement.stage is None else measurement.stage.published
    estimates = {(r.figure.quantity, r.figure.axis): r.figure.estimate for r in measurement.rows}
    for result in measurement.characterisation.results:
        fit = result.details.get("fit")
        if fit is None or not fit.modes:
            continue
        axis = result.test.axis
        published_hz = measured_value(published, "natural_frequency_hz", axis)
        agree = (
            " The simulated stage is set to the published value: that both agree shows nothing."
            if published_hz is not None
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
                "published_hz": published_hz,
            },
        )


def centring_section(trial: CentringTrial | str | None) -> Iterator[Content]:
    """Yield the centring of a scale, if it was requested."""
    if trial is None:
        return
    if isinstance(trial, str):
        yield f"No scale could be centred: {trial}."
        return
    centring = trial.procedure
    rows = []
    for count, step in enumerate(centring.steps):
        length = step.reading.length
        low, high = length.interval()
        expected = "" if step.predicted is None else f"{step.predicted.interval()[1] * 1e6:.3f}"
        places = (f"{value * 1e6:.3f}" for value in (*step.command, length.value))
        between = f"{low * 1e6:.3f} to {high * 1e6:.3f}"
        rows.append((count, step.kind, *places, between, expected))
    target = "met" if centring.reached else "not met"
    yield (
        f"A scale of {2e3 * SCALE_RADIUS:g} mm diameter has an eccentricity of "
        f"{ECCENTRICITY * 1e6:g} µm on a simulated rotary table. {len(HEADS)} heads read it with "
        f"{HEAD_NOISE:g} arcsec of noise; its graduation error is {LINE_ERRORS:g} arcsec (rms). "
        "The stage turns with the table; trial moves determine its unknown mounting angle and "
        "mirroring. Each position is approached from the low end of both axes. True residual "
        f"eccentricity: {trial.residual * 1e9:.2g} nm "
        f"(target {target}: {centring.reason})."
    )
    heads = (
        "", "step", "x [µm]", "y [µm]", "eccentricity [µm]", "95 % interval", "predicted, at most",
    )  # fmt: skip
    yield table("Steps of the centring; simulated.", heads, rows)
    words = "Angle error read by the first head before and after centring; simulated."
    draw = partial(draw_polar, trial.fits, trial.angles)
    yield Pictures(pictures=(Picture(result=draw, title="scale before and after", caption=words),))


def quiet_section(study: "Study") -> Iterator[Content]:
    """Yield the rms of an environment by source, if the study has one."""
    result = study.budget
    if result is None or isinstance(result, str):
        if result:
            yield f"The rms could not be computed: {result}."
        return
    (low, high), name = result.environment.band, result.environment.name
    request = study.request
    requested = isinstance(request, StudyRequest) and request.environment is not None
    origin = (
        "is the one given"
        if requested
        else "is assumed, not measured: study --environment FILE takes another"
    )
    others = {p.relative_to for p in result.environment.points} - {"base"}
    against = "the base" if not others else "what each point names"
    yield (
        f"The environment '{name}' {origin}. Rms from {low:g} to {high:g} Hz against {against}, "
        f"drives in place, without position control; {result.model} model."
    )
    # displacements and rotations have tables of their own
    for unit in dict.fromkeys(b.unit for b in result.budgets):
        budgets = [b for b in result.budgets if b.unit == unit]
        heads = ("<source", "<acts", *(b.point for b in budgets))
        yield table(f"Rms by source [{rms_unit(budgets)[1]}].", heads, rms_rows(budgets))
        for b in (b for b in budgets if b.tree is not None):
            named, columns, rows = tree_table([b])
            yield table(f"Errors of {b.point}, standard uncertainty [{named}].", columns, rows)
    yield Pictures(
        pictures=tuple(
            Picture(
                result=result,
                options={"point": b.point},
                title=f"density and cumulative amplitude of {b.point}",
                caption=f"Density and cumulative amplitude of {b.point} by source. One per cent "
                f"more changes the total: {_ranking_words(b)}.",
                size="small",
            )
            for b in result.budgets
        )
    )
    yield from (f"{note[:1].upper()}{note[1:]}." for note in result.notes)


def _ranking_words(budget: "PointBudget") -> str:
    """Return the two parameters that change the total most."""
    return ", ".join(f"{name} {change:+.2f} %" for name, change in budget.ranking()[:2])
