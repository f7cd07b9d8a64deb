"""Hinges: the contour of a notch, and the largest stress in every one against what is allowed."""

from typing import TYPE_CHECKING, Any

import numpy as np

from flexstage.errors import ModelError
from flexstage.hinges import Profile
from flexstage.report.figures.shapes import notch_contour
from flexstage.report.figures.style import (
    BODY,
    CYCLE,
    INK,
    MM,
    MPA,
    MUTED,
    add_legend,
    entitle,
    one_panel,
)
from flexstage.report.tables import cause_words
from flexstage.system import Analysis
from flexstage.system.characteristics import pulsating_limit

if TYPE_CHECKING:
    from matplotlib.figure import Figure


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
    entitle(axes, f"{profile.kind} notch, neck {profile.neck_thickness * MM:g} mm")
    return figure


def draw_stress(analysis: Analysis) -> "Figure":
    """Draw a bar for every hinge and axis, the most stressed hinge first.

    Hinges carry the numbers of the drawing.
    """
    from matplotlib.patches import Patch

    most = 48  # bars beyond this are too thin to read
    nothing = 0.01  # less than this part of the largest stress is not drawn

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
        # an axis that leaves a hinge at rest gets no room in its row
        bars = [
            (values[name] * MPA, CYCLE[k % len(CYCLE)])
            for k, values in enumerate(stress.values())
            if values[name] > nothing * largest[names[0]]
        ]
        height = 0.72 / max(len(bars), 1)
        for k, (value, colour) in enumerate(bars):
            at = row + (k - 0.5 * (len(bars) - 1)) * height
            axes.barh(at, value, height=height, color=colour)
            axes.annotate(
                f"{value:.0f}", (value, at), xytext=(2, 0), textcoords="offset points",
                va="center", fontsize=6, color=MUTED,
            )  # fmt: skip
    material = analysis.stage.material
    limits: list[tuple[float, str, Any]] = [
        (limit * MPA, label, dashes)
        for limit, label, dashes in (
            (pulsating_limit(material), "fatigue, 0 to peak, allows", (0, (4, 2))),
            (material.yield_strength, "yield", "solid"),
        )
        if limit is not None
    ]
    furthest = max([*(value for value, *_ in limits), largest[names[0]] * MPA]) or 1.0
    limits.sort(key=lambda limit: limit[0])
    # two limits of nearly the same height have their words on either side
    apart = len(limits) < 2 or limits[1][0] - limits[0][0] > 0.25 * furthest
    for i, (limit, label, dashes) in enumerate(limits):
        axes.axvline(limit, color=INK, linestyle=dashes, linewidth=1.0)
        axes.annotate(
            f"{label} {limit:.0f} MPa", (limit, 1.0), xycoords=("data", "axes fraction"),
            xytext=(0, 3), textcoords="offset points", fontsize=7.5, color=INK,
            ha="center" if apart else ("right", "left")[i],
        )  # fmt: skip
    axes.set(xlim=(0.0, 1.08 * furthest), ylim=(len(names) - 0.4, -0.6))
    axes.set_yticks(
        rows, [f"{name} · {numbers[name]}" for name in names], fontsize=6.5, parse_math=False
    )
    axes.set_xlabel(f"equivalent stress [MPa], {material.name}", parse_math=False)
    left_out = len(numbers) - len(names)
    if left_out:
        axes.annotate(
            f"{left_out} hinges with less stress are not shown", (1.0, 0.01),
            xycoords="axes fraction", ha="right", fontsize=7, color=MUTED,
        )  # fmt: skip
    of = cause_words(analysis)
    handles = [
        Patch(color=CYCLE[k % len(CYCLE)], label=f"{of} {axis} at full stroke")
        for k, axis in enumerate(stress)
    ]
    add_legend(figure, handles=handles, loc="outside lower right", ncols=len(handles))
    return figure
