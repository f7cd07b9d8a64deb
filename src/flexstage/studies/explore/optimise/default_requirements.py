"""What is required of every stage without being asked, and figures that were published."""

import math
from collections.abc import Collection, Iterable, Mapping

from flexstage.base.choose import did_you_mean
from flexstage.base.errors import ModelError
from flexstage.quantities.quantity import full_name
from flexstage.stage import PiezoStack, Stage
from flexstage.stage.designs.template import StageTemplate
from flexstage.stage.narrowest import thinnest_wall
from flexstage.studies.explore.figures import Figure, Requirement
from flexstage.studies.explore.variables import Variable, every_variable, is_data_sheet

#: Safety against yield that machine parts under static load usually have [1].
SAFETY = 1.5
#: Thinnest wall of a body [m]: shops that cut and mill aluminium name 0.5 mm by wire at best, and
#: 0.8 to 1 mm as what they take without asking back, in guidelines for their customers.
THINNEST_WALL = 1e-3
#: Thinnest wall of a body that something is bolted to [m]: what takes an M2 thread (least boss in
#: TR Fastenings' table of screws for aluminium: 3.32 mm).
BOLTED = 3.3e-3
#: Share of the stroke as described that an axis keeps where nothing else is said of it [1].
STROKE = 0.9
#: What stands for the checks of `flexstage.stage.check` where they are not to be required.
CHECK = "check"
#: Share by which every dimension is varied to either side where nothing is said [1].
SHARE = 0.3
# what says as much of the stress of an axis as the safety against yield
_STRESS = ("max_stress", "safety_factor", "fatigue_safety")
# what a stroke is called, and what says as much of it
_STROKES = ("output_displacement", "rotation_stroke")
_OF_STROKE = (*_STROKES, "transmission_ratio")
# figures that a published one follows from, where that was published too
_FOLLOWS = {
    "transmission_ratio": ("output_displacement",),
    "resolution": ("output_displacement", "transmission_ratio"),
}
# what belongs to bought parts, bolts and the material is not varied unless it is named; nor is
# the thickness of the plate
_BOUGHT = ("actuator", "mounting_hole", "force_patch", "material")
_PLATE = "thickness"


def usual_requirements(
    stage: Stage,
    known: Mapping[tuple[str, str], float],
    asked: Iterable[Requirement],
    without: Iterable[str] = (),
    *,
    goals: Iterable[Figure] = (),
) -> tuple[Requirement, ...]:
    """Return what is required without being asked: what can be stressed and driven.

    Each axis keeps `STROKE` of its stroke, unless stroke or ratio of it is a goal or asked for: a
    stage that hardly moves has any frequency.
    The safety against yield is `SAFETY`. Walls of bodies are no thinner than `THINNEST_WALL`, those
    of an output body, to which something is bolted, no thinner than `BOLTED`, or than they are
    described where that is less. At the input the stage is no stiffer than its actuator, so
    that half of the free stroke is left, and its full stroke takes no more than the blocking force
    of a stack. A requirement that is asked for takes the place of one of these, of stress that of
    the safety of its axis.

    Parameters
    ----------
    stage : Stage
        The stage as it is described.
    known : Mapping
        The figures that there are, of the stage as described, by quantity and axis.
    asked : iterable of Requirement
        What is asked for.
    without : iterable of str
        Names of what is not required, such as ``safety_factor``, ``safety_factor.x`` or ``stroke``.
    goals : iterable of Figure
        What is made best.

    Raises
    ------
    ModelError
        A name in `without` is none of them.
    """
    usual = [
        *(Requirement(figure=f, low=SAFETY) for f in _figures("safety_factor", known)),
        *(
            Requirement(figure=f, high=stiffest)
            for f in _figures("input_stiffness", known)
            if (stiffest := _stiffest(stage, f.axis)) is not None
        ),
    ]
    usual += _walls(stage, known)
    usual += _strokes(known)
    dropped = [full_name(name) for name in without]
    names = {CHECK, *(name for r in usual for name in (r.figure.name, r.figure.quantity))}
    for name in dropped:
        if name not in names:
            raise ModelError(
                f"nothing called '{name[:60]}' is required without being asked"
                f"{did_you_mean(name, sorted(names))}; that is "
                f"{', '.join([CHECK, *(r.figure.name for r in usual)])}"
            )
    said = {r.figure.key for r in asked}
    moved = {a for q, a in said.union(goal.key for goal in goals) if q in _OF_STROKE}
    stressed = {axis for quantity, axis in said if quantity in _STRESS}
    return tuple(
        r
        for r in usual
        if r.figure.key not in said
        and not (r.figure.quantity in _STRESS and r.figure.axis in stressed)
        and not (r.figure.quantity in _STROKES and r.figure.axis in moved)
        and not {r.figure.name, r.figure.quantity} & set(dropped)
    )


def _walls(stage: Stage, known: Iterable[tuple[str, str]]) -> list[Requirement]:
    """Return what walls may be: no more is asked than the stage has."""
    outputs = {axis.name: stage.probe(axis.probe).body for axis in stage.axes}
    found: dict[str | None, Requirement] = {}
    for quantity, least in (("smallest_wall", THINNEST_WALL), ("output_wall", BOLTED)):
        for figure in _figures(quantity, known):
            body = outputs.get(figure.axis)
            # whole um, downwards: the stage itself keeps it
            own = float(f"{1e-6 * math.floor(1e6 * thinnest_wall(stage, body) + 1e-3):.9g}")
            if own > 0.0 and body not in found:  # axes that share a body share its wall
                found[body] = Requirement(figure=figure, low=min(least, own))
    return list(found.values())


def _strokes(known: Mapping[tuple[str, str], float]) -> list[Requirement]:
    """Return what strokes may be, to three digits."""
    limits = [
        (Figure(quantity=quantity, axis=axis), float(f"{STROKE * value:.3g}"))
        for (quantity, axis), value in known.items()
        if quantity in _STROKES and value
    ]
    return [
        Requirement(figure=f, low=v) if v > 0.0 else Requirement(figure=f, high=v)
        for f, v in limits
    ]


def walls_note(usual: Iterable[Requirement]) -> str:
    """Return in a sentence where the limits of walls come from; empty where there are none."""
    if not any(r.figure.quantity in ("smallest_wall", "output_wall") for r in usual):
        return ""
    return (
        f"walls: {1e3 * THINNEST_WALL:g} mm is what shops cut in aluminium without asking back, "
        f"{1e3 * BOLTED:g} mm of the output body take an M2 thread; where the stage as described "
        "has less, that is the limit"
    )


def _figures(quantity: str, known: Iterable[tuple[str, str]]) -> list[Figure]:
    return [Figure(quantity=q, axis=a) for q, a in known if q == quantity]


def _stiffest(stage: Stage, axis: str) -> float | None:
    """Return the stiffness that an axis may have at its input [N/m], None where nothing says so.

    An axis of several drives has no one input.
    """
    name = next(a.drive for a in stage.axes if a.name == axis)
    if name is None:
        return None
    drive = stage.drive(name)
    limits = [drive.spring] if drive.spring else []
    if isinstance(drive, PiezoStack) and drive.blocking_force is not None:
        limits.append(drive.blocking_force / drive.free_stroke)
    return min(limits, default=None)


def published_targets(stage: Stage, known: Collection[tuple[str, str]]) -> tuple[Requirement, ...]:
    """Return the figures of finite elements that were published of a stage, as values to match.

    Without what a drive is given, and without what follows from others that were published: the
    ratio and the resolution beside the displacement.

    Raises
    ------
    ModelError
        None were published of it.

    Examples
    --------
    >>> from flexstage.stage.designs import design
    >>> stage = design("vgtu-piezo")
    >>> known = {(row.quantity, row.axis) for row in stage.published}
    >>> [target.text for target in published_targets(stage, known)][:2]
    ['output_displacement.x = 64.6 µm', 'output_displacement.y = 62.71 µm']
    """
    rows = [row for row in stage.published if row.origin == "published-fem"]
    published = {(row.quantity, row.axis) for row in rows}
    targets = tuple(
        Requirement(
            figure=Figure(quantity=row.quantity, axis=row.axis), low=row.value, high=row.value
        )
        for row in rows
        if (row.quantity, row.axis) in known
        and row.quantity != "input_displacement"
        and not any((q, row.axis) in published for q in _FOLLOWS.get(row.quantity, ()))
    )
    if not targets:
        raise ModelError(
            f"no finite-element figures are published of {stage.name}: name values to match, such "
            'as --match "natural_frequency.x = 320 Hz"'
        )
    return targets


def usual_variables(template: StageTemplate) -> tuple[Variable, ...]:
    """Return the dimensions that are varied where none is named: those of the flexure alone.

    What belongs to bought parts and bolts stays, and so does the thickness of the plate.

    Examples
    --------
    >>> [variable.name for variable in usual_variables(StageTemplate.of("parallelogram"))][:2]
    ['leg_spacing', 'leg.notch.neck_thickness']
    """
    return tuple(v for v in every_variable(template, SHARE) if not _stays(v.name))


def held_dimensions(template: StageTemplate) -> str:
    """Return in a sentence which dimensions `usual_variables` leaves as they are; empty: none."""
    names = [
        v.name
        for v in every_variable(template, SHARE)
        if _stays(v.name) and not is_data_sheet(v.name)
    ]
    if not names:
        return ""
    return (
        "held, as they belong to bought parts, bolts or the plate (--over NAME=RANGE varies one): "
        f"{', '.join(names)}"
    )


def _stays(name: str) -> bool:
    return name == _PLATE or any(word in name for word in _BOUGHT)
