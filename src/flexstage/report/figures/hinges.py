"""Hinges: contour of a notch, stress in each hinge with its limits, stress fields at necks."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from flexstage.base.arrays import Array
from flexstage.base.errors import ModelError
from flexstage.hinges import Profile
from flexstage.quantities.quantity import number, round_below
from flexstage.report.figures.body_motion import drawn_axis, elongation_words, exaggeration
from flexstage.report.figures.fields import Bands, add_bar, fill, frame, place, trace, window
from flexstage.report.figures.shapes import Placer, notch_contour
from flexstage.report.figures.style import (
    BODY,
    CYCLE,
    DASHED,
    INK,
    MM,
    MPA,
    MUTED,
    PAPER,
    add_legend,
    add_words,
    label_axes,
    new_figure,
    on_paper,
    one_panel,
    set_title,
    style_axes,
)
from flexstage.report.tables import cause_words
from flexstage.stage import Hinge
from flexstage.system import Analysis
from flexstage.system.characteristics import pulsating_limit

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from flexstage.fem import StageModel
    from flexstage.fem.sampling import Sample, Sampler


def draw_notch(profile: Profile) -> "Figure":
    """Draw the contour of a notch to scale, in millimetres, with the neck in the middle."""
    half = 0.5 * profile.neck_thickness
    right = [(x * MM, depth * MM) for x, depth in notch_contour(profile)]
    edge = [(-x, depth) for x, depth in reversed(right)] + right
    x = [place for place, _ in edge]
    upper = [half * MM + depth for _, depth in edge]
    lower = [-half * MM - (0.0 if profile.one_sided else depth) for _, depth in edge]
    figure, axes = one_panel(4.5, 3.2)
    axes.fill_between(x, lower, upper, facecolor=BODY, edgecolor=INK, linewidth=1.0)
    axes.set(xlabel="along the hinge [mm]", ylabel="across [mm]", aspect="equal")
    set_title(axes, f"{profile.kind} notch, neck {profile.neck_thickness * MM:g} mm")
    return figure


def draw_stress(analysis: Analysis) -> "Figure":
    """Draw a bar for every hinge and axis, the most stressed hinge first.

    Hinges carry the numbers of the drawing.
    """
    from matplotlib.patches import Patch

    most = 48  # more bars would be too thin to read
    smallest = 0.01  # smaller stress is not drawn, relative to the largest

    stress = {axis: values for axis, values in analysis.hinge_stress.items() if values}
    if not stress:
        raise ModelError("the analysis has no stress in hinges to draw")
    numbers = {hinge.name: i for i, hinge in enumerate(analysis.stage.hinges, start=1)}
    largest = {name: max(values[name] for values in stress.values()) for name in numbers}
    names = sorted(numbers, key=lambda name: (-round(largest[name], 3), numbers[name]))[:most]
    figure, axes = one_panel(8.6, 0.21 * len(names) + 1.5)
    axes.grid(visible=False, axis="y")
    rows = np.arange(len(names))
    for row, name in enumerate(names):
        # an axis without stress in a hinge has no bar in its row
        bars = [
            (values[name] * MPA, CYCLE[k % len(CYCLE)])
            for k, values in enumerate(stress.values())
            if values[name] > smallest * largest[names[0]]
        ]
        height = 0.72 / max(len(bars), 1)
        for k, (value, colour) in enumerate(bars):
            at = row + (k - 0.5 * (len(bars) - 1)) * height
            axes.barh(at, value, height=height, color=colour)
            add_words(axes, f"{value:.0f}", (value, at), (2, 0), 6, MUTED, va="center")
    material = analysis.stage.material
    limits: list[tuple[float, str, Any]] = [
        (limit * MPA, label, dashes)
        for limit, label, dashes in (
            (pulsating_limit(material), "pulsating fatigue limit", DASHED),
            (material.yield_strength, "yield", "solid"),
        )
        if limit is not None
    ]
    furthest = max([*(value for value, *_ in limits), largest[names[0]] * MPA]) or 1.0
    limits.sort(key=lambda limit: limit[0])
    # labels of two limits close to each other are on either side
    far_apart = len(limits) < 2 or limits[1][0] - limits[0][0] > 0.25 * furthest
    for i, (limit, label, dashes) in enumerate(limits):
        axes.axvline(limit, color=INK, linestyle=dashes, linewidth=1.0)
        add_words(
            axes,
            f"{label} {limit:.0f} MPa",
            (limit, 1.0),
            (0, 3),
            xycoords=("data", "axes fraction"),
            ha="center" if far_apart else ("right", "left")[i],
        )
    axes.set(xlim=(0.0, 1.08 * furthest), ylim=(len(names) - 0.4, -0.6))
    axes.set_yticks(
        rows, [f"{name} · {numbers[name]}" for name in names], fontsize=6.5, parse_math=False
    )
    axes.set_xlabel(f"equivalent stress [MPa], {material.name}", parse_math=False)
    omitted = len(numbers) - len(names)
    if omitted:
        axes.annotate(
            f"{omitted} hinges with less stress are not shown", (1.0, 0.01),
            xycoords="axes fraction", ha="right", fontsize=7, color=MUTED,
        )  # fmt: skip
    of = cause_words(analysis)
    handles = [
        Patch(color=CYCLE[k % len(CYCLE)], label=f"{of} {axis} at full stroke")
        for k, axis in enumerate(stress)
    ]
    add_legend(figure, handles=handles, loc="outside lower right", ncols=len(handles))
    return figure


#: Colours of stress, and the transparent part of their scale [1].
STRESS_COLOURS, STRESS_CLEAR = "YlOrRd", 0.25
_OVERVIEW, _MARGIN = 5.0, 0.035  # larger side of the whole stage [inch], room about it


@dataclass(frozen=True, slots=True, kw_only=True)
class StressedNeck:
    """A neck that represents all with equal profile and stress."""

    hinge: Hinge
    """Its hinge."""
    number: int
    """The number of the hinge in the drawing."""
    stress: float
    """Largest equivalent stress on its surface [Pa]."""
    count: int
    """Number of hinges of the same profile and stress, itself included."""


def worst_necks(analysis: Analysis, axis: str, most: int = 4) -> tuple[StressedNeck, ...]:
    """Return the most stressed necks, worst first, one for all of the same profile and stress.

    The drive of the axis is at full stroke; none where no hinge bears stress.
    """
    tolerance = 0.05  # necks of one profile whose stress differs by less are shown once
    stress = analysis.hinge_stress[axis]
    hinges = [(i, h) for i, h in enumerate(analysis.stage.hinges, start=1) if h.name in stress]
    largest = max(stress.values(), default=0.0)
    if not largest > 0.0:
        return ()
    groups: list[list[tuple[int, Hinge]]] = []

    def rank(entry: tuple[int, Hinge]) -> tuple[float, int]:
        # necks that differ only by the mesh are in order of their numbers
        i, hinge = entry
        return -round(stress[hinge.name] / largest, 3), i

    for i, hinge in sorted(hinges, key=rank):
        for group in groups:
            first = group[0][1]
            same = abs(stress[hinge.name] - stress[first.name]) <= tolerance * stress[first.name]
            if same and first.profile == hinge.profile:
                group.append((i, hinge))
                break
        else:
            groups.append([(i, hinge)])
    return tuple(
        StressedNeck(hinge=g[0][1], number=g[0][0], stress=stress[g[0][1].name], count=len(g))
        for g in groups[:most]
        if stress[g[0][1].name] > 0.01 * largest
    )


def neck_sampler(model: "StageModel") -> "Sampler":
    """Return a sampler of the fields of a model, fine enough for a picture of a neck.

    In the plane, or on the middle plane of a solid.
    """
    from flexstage.fem.sampling import Sampler

    return Sampler(model=model, divisions=6)


def draw_neck_stress(
    model: "StageModel", analysis: Analysis, axis: str, *, sampler: "Sampler | None" = None
) -> "Figure":
    """Draw the stress of the whole stage and about its most stressed necks.

    The drive of the axis is at full stroke, the others removed. The equivalent stress of von Mises,
    of a solid on the middle plane, is drawn on the deformed shape; titles give the magnification. A
    neck stays in the centre of its picture. The ring marks the largest stress on the surface of the
    notch. Several figures of one model may share its sampler.
    """
    result = drawn_axis(analysis, axis)
    necks = worst_necks(analysis, axis)
    if not necks:
        raise ModelError(f"no hinge bears stress when axis '{axis}' is driven")
    sampler = sampler or neck_sampler(model)
    sample = sampler.read(result.static.q)
    bands = Bands(0.0, necks[0].stress * MPA, STRESS_COLOURS, clear=STRESS_CLEAR)

    x0, y0, x1, y1 = window(sample.points[:, :2], _MARGIN)
    figure, overview, panels, bar = _lay_out((y1 - y0) / (x1 - x0), len(necks))
    peaks = [sampler.neck_peak(result.static.q, n.hinge.name) for n in necks]
    factor = _overview(overview, sampler, sample, bands)
    _letters(overview, sample, necks, factor)
    set_title(overview, f"{axis}: {elongation_words(result)}; motion × {factor:g}")
    for letter, axes, neck, (at, _) in zip("ABCD", panels, necks, peaks, strict=False):
        _neck(axes, sampler, sample, bands, neck, at, letter)
    add_bar(bar, bands, "von Mises stress [MPa]")
    return figure


def _lay_out(aspect: float, count: int) -> "tuple[Figure, Axes, list[Axes], Axes]":
    """Lay out the overview by its aspect ratio, the pictures of the necks, and the colour bar."""
    left, top, foot, title, gap = 0.62, 0.42, 0.5, 0.4, 0.15
    width = min(_OVERVIEW, _OVERVIEW / aspect)
    rows, columns = (1, 1) if count == 1 else (2, math.ceil(count / 2))
    height = max(width * aspect, 3.4)
    side = min((height - (rows - 1) * title) / rows, 4.0)
    across = left + width + gap
    total = across + columns * (side + gap) + 0.95
    figure = new_figure(total, top + height + foot)
    figure.set_layout_engine("none")
    overview = place(figure, left, top, width, width * aspect)
    panels = [
        place(
            figure,
            across + (i % columns) * (side + gap),
            top + (i // columns) * (side + title),
            side,
            side,
        )
        for i in range(count)
    ]
    bar = place(figure, total - 0.88, top + 0.1 * height, 0.14, 0.8 * height)
    return figure, overview, panels, bar


def _overview(axes: "Axes", sampler: "Sampler", sample: "Sample", bands: Bands) -> float:
    """Draw the complete stage; return the magnification of its motion."""
    x0, y0, x1, y1 = window(sample.points[:, :2], 0.0)
    size = max(x1 - x0, y1 - y0)
    factor = exaggeration(size, float(sample.magnitude.max()))
    style_axes(axes, grid=False)
    frame(axes, window(sample.points[:, :2], _MARGIN), ticks=True)
    label_axes(axes, "x [mm]", "y [mm]", 8)
    moved = sample.moved(factor)[:, :2]
    fill(axes, moved, sample.cells, sample.von_mises * MPA, sampler.outline, bands)
    trace(axes, moved, sampler.outline, linewidths=0.35)
    return factor


def _letters(axes: "Axes", sample: "Sample", necks: Sequence[StressedNeck], factor: float) -> None:
    """Label the necks that have a picture of their own."""
    (x0, x1), (y0, y1) = axes.get_xlim(), axes.get_ylim()
    size = 0.045 * max(x1 - x0, y1 - y0)
    placer = Placer((x0, y0, x1, y1))
    centres: list[tuple[float, float]] = []
    for neck in necks:
        x, y = (
            MM * (np.array(neck.hinge.at) + factor * _motion(sample, neck.hinge.at)[:2])
        ).tolist()
        placer.take(x, y, 0.4 * size, 0.4 * size)
        centres.append((x, y))
    for k, (letter, (x, y)) in enumerate(zip("ABCD", centres, strict=False)):
        # away from the nearest of the others, so that no two lines cross
        others = [(x - a, y - b) for i, (a, b) in enumerate(centres) if i != k]
        ax, ay = min(others, key=lambda d: math.hypot(*d), default=(1.0, 0.0))
        preferred = math.atan2(ay, ax)
        turns = sorted((math.pi / 12.0 * i for i in range(-12, 12)), key=abs)
        places = [
            (x + r * size * math.cos(preferred + t), y + r * size * math.sin(preferred + t))
            for r in (1.6, 2.4)
            for t in turns
        ]
        place = next((p for p in places if placer.is_free(*p, size, size)), places[0])
        placer.take(*place, size, size)
        axes.annotate(
            letter, (x, y), place, ha="center", va="center", fontsize=7.5, color=PAPER,
            fontweight="bold", zorder=6,
            bbox={"boxstyle": "circle,pad=0.22", "facecolor": INK, "edgecolor": PAPER},
            arrowprops={"arrowstyle": "-", "color": INK, "linewidth": 0.8, "shrinkB": 0.0},
        )  # fmt: skip


def _neck(
    axes: "Axes",
    sampler: "Sampler",
    sample: "Sample",
    bands: Bands,
    neck: StressedNeck,
    peak: Array,
    letter: str,
) -> None:
    lengths = 2.6  # side of a picture of a neck, in lengths of its notch
    hinge = neck.hinge
    half = 0.5 * lengths * max(hinge.profile.length, 3.0 * hinge.profile.neck_thickness)
    (x, y), neck_motion = hinge.at, _motion(sample, hinge.at)
    near = np.abs(sample.points[:, :2] - hinge.at).max(axis=1) < half
    relative = sample.displacement - neck_motion
    largest = float(np.linalg.norm(relative[near], axis=1).max())
    factor = exaggeration(6.0 * half, largest)
    moved = (sample.points + factor * relative)[:, :2]
    sight = (x - half, y - half, x + half, y + half)
    style_axes(axes, grid=False)
    frame(axes, sight, ticks=False)
    fill(axes, moved, sample.cells, sample.von_mises * MPA, sampler.outline, bands)
    at_rest = sample.points[:, :2]
    trace(axes, at_rest, sampler.outline, linewidths=0.5, colors=MUTED, linestyles=[(0, (3, 2))])
    trace(axes, moved, sampler.outline, linewidths=0.6)
    peak_motion = (
        sample.displacement[np.argmin(np.linalg.norm(sample.points - peak, axis=1))] - neck_motion
    )
    where = MM * (peak + factor * peak_motion)[:2]
    ring = {"fillstyle": "none", "markersize": 13, "zorder": 5}
    axes.plot(*where, "o", color=PAPER, markeredgewidth=2.4, **ring)
    axes.plot(*where, "o", color=INK, markeredgewidth=1.0, **ring)
    like = f", {neck.count - 1} more equal" if neck.count > 1 else ""
    # adding 0 makes a rounded minus zero positive
    px, py = (f"{round(MM * float(v), 2) + 0.0:.2f}".replace("-", "−") for v in peak[:2])
    set_title(
        axes,
        f"{letter} · {neck.hinge.name} · {neck.number}{like}\n"
        f"{number(neck.stress * MPA)} MPa at ({px}, {py}) mm",
        8.0,
    )
    _ruler(axes, half, f"; motion × {factor:g}")


def _ruler(axes: "Axes", half: float, words: str) -> None:
    """Draw a scale bar of round length with a label."""
    length = round_below(0.6 * half * MM)
    (x0, x1), (y0, y1) = axes.get_xlim(), axes.get_ylim()
    x, y = x0 + 0.04 * (x1 - x0), y0 + 0.05 * (y1 - y0)
    axes.plot([x, x + length], [y, y], color=INK, linewidth=1.6, zorder=7)
    add_words(axes, f"{length:g} mm{words}", (x, y), (0, 4), 7, zorder=7, bbox=on_paper(1.2, 0.8))


def _motion(sample: "Sample", at: Sequence[float]) -> Array:
    """Return the displacement of the corner nearest to a point [m]."""
    distance = np.hypot(*(sample.points[:, :2] - np.asarray(at)[:2]).T)
    return sample.displacement[int(np.argmin(distance))]
