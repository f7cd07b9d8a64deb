"""Default requirements and variables of an optimisation, and published values as targets."""

import math
from collections.abc import Collection, Iterable, Mapping

from flexstage.base.choose import did_you_mean
from flexstage.base.errors import ModelError
from flexstage.quantities.quantity import full_name
from flexstage.stage import PiezoStack, Stage
from flexstage.stage.designs.source import StageTemplate
from flexstage.stage.narrowest import thinnest_wall
from flexstage.studies.explore.figures import Figure, Requirement
from flexstage.studies.explore.variables import Variable, every_variable, is_data_sheet

#: Usual safety factor against yield of machine parts under static load [1].
SAFETY = 1.5
#: Thinnest wall of a body [m]: guidelines of workshops for aluminium give 0.5 mm as the limit of
#: wire erosion, and 0.8 to 1 mm as the minimum wall that most of them accept.
THINNEST_WALL = 1e-3
#: Thinnest wall of a body with bolted parts [m]: that of an M2 thread (least boss in TR Fastenings'
#: table of screws for aluminium: 3.32 mm).
THREADED_WALL = 3.3e-3
#: Default lower limit of the stroke, as a share of the described stroke [1].
STROKE = 0.9
#: Name of the checks of `flexstage.stage.check` among the default requirements.
CHECK = "check"
#: Default range of a dimension to either side, as a share of its value [1].
SHARE = 0.3
# quantities that limit the stress of an axis, as the safety factor against yield does
_STRESS = ("max_stress", "safety_factor", "fatigue_safety")
# strokes, and quantities that limit them as well
_STROKES = ("output_displacement", "rotation_stroke")
_OF_STROKE = (*_STROKES, "transmission_ratio")
# published quantities from which another one follows
_FOLLOWS = {
    "transmission_ratio": ("output_displacement",),
    "resolution": ("output_displacement", "transmission_ratio"),
}
# parameters of bought parts, bolts and the material, and the plate thickness: not varied by default
_BOUGHT = ("actuator", "mounting_hole", "force_patch", "material")
_PLATE = "thickness"


def default_requirements(
    stage: Stage,
    known: Mapping[tuple[str, str], float],
    requested: Iterable[Requirement],
    without: Iterable[str] = (),
    *,
    goals: Iterable[Figure] = (),
) -> tuple[Requirement, ...]:
    """Return the default requirements on stress, drive, stroke and walls.

    Each axis keeps `STROKE` of its stroke, unless its stroke or ratio is a goal or a requirement: a
    stage of small stroke can have any frequency. The safety factor against yield is `SAFETY`. Walls
    are no thinner than `THINNEST_WALL`, and those of an output body, with bolted parts, no thinner
    than `THREADED_WALL`, or than in the description if that is less. The input stiffness is at most
    that of the actuator, so that half of the free stroke remains, and the force at full stroke is
    at most the blocking force of a stack. A requested requirement replaces a default one on the
    same quantity; one on stress replaces the safety factor of its axis.

    Parameters
    ----------
    stage : Stage
        The described stage.
    known : Mapping
        Available figures of the described stage, by quantity and axis.
    requested : iterable of Requirement
        Requested requirements.
    without : iterable of str
        Names of disabled defaults, such as ``safety_factor``, ``safety_factor.x`` or ``stroke``.
    goals : iterable of Figure
        Figures of the goals.

    Raises
    ------
    ModelError
        A name in `without` is not that of a default requirement.
    """
    defaults = [
        *(Requirement(figure=f, low=SAFETY) for f in _figures("safety_factor", known)),
        *(
            Requirement(figure=f, high=stiffest)
            for f in _figures("input_stiffness", known)
            if (stiffest := _stiffest(stage, f.axis)) is not None
        ),
    ]
    defaults += _walls(stage, known)
    defaults += _strokes(known)
    disabled = [full_name(name) for name in without]
    names = {CHECK, *(name for r in defaults for name in (r.figure.name, r.figure.quantity))}
    for name in disabled:
        if name not in names:
            raise ModelError(
                f"there is no default constraint '{name[:60]}'"
                f"{did_you_mean(name, sorted(names))}; the default constraints are "
                f"{', '.join([CHECK, *(r.figure.name for r in defaults)])}"
            )
    keys = {r.figure.key for r in requested}
    with_stroke = {a for q, a in keys.union(goal.key for goal in goals) if q in _OF_STROKE}
    with_stress = {axis for quantity, axis in keys if quantity in _STRESS}
    return tuple(
        r
        for r in defaults
        if r.figure.key not in keys
        and not (r.figure.quantity in _STRESS and r.figure.axis in with_stress)
        and not (r.figure.quantity in _STROKES and r.figure.axis in with_stroke)
        and not {r.figure.name, r.figure.quantity} & set(disabled)
    )


def _walls(stage: Stage, known: Iterable[tuple[str, str]]) -> list[Requirement]:
    """Return the requirements on walls, which the described stage meets."""
    outputs = {axis.name: stage.probe(axis.probe).body for axis in stage.axes}
    walls: dict[str | None, Requirement] = {}
    for quantity, least in (("smallest_wall", THINNEST_WALL), ("output_wall", THREADED_WALL)):
        for figure in _figures(quantity, known):
            body = outputs.get(figure.axis)
            # rounded down to whole um, so that the described stage meets it
            described = float(f"{1e-6 * math.floor(1e6 * thinnest_wall(stage, body) + 1e-3):.9g}")
            if described > 0.0 and body not in walls:  # axes may share an output body
                walls[body] = Requirement(figure=figure, low=min(least, described))
    return list(walls.values())


def _strokes(known: Mapping[tuple[str, str], float]) -> list[Requirement]:
    """Return the requirements on strokes, rounded to three digits."""
    limits = [
        (Figure(quantity=quantity, axis=axis), float(f"{STROKE * value:.3g}"))
        for (quantity, axis), value in known.items()
        if quantity in _STROKES and value
    ]
    return [
        Requirement(figure=f, low=v) if v > 0.0 else Requirement(figure=f, high=v)
        for f, v in limits
    ]


def wall_note(defaults: Iterable[Requirement]) -> str:
    """Return the origin of the limits of walls as a note; empty without such limits."""
    if not any(r.figure.quantity in ("smallest_wall", "output_wall") for r in defaults):
        return ""
    return (
        f"walls: most workshops accept at least {1e3 * THINNEST_WALL:g} mm in aluminium, and an M2 "
        f"thread in the output body needs {1e3 * THREADED_WALL:g} mm; a thinner wall of the "
        "described stage is the limit instead"
    )


def _figures(quantity: str, known: Iterable[tuple[str, str]]) -> list[Figure]:
    return [Figure(quantity=q, axis=a) for q, a in known if q == quantity]


def _stiffest(stage: Stage, axis: str) -> float | None:
    """Return the largest permissible input stiffness of an axis [N/m]; None without a limit.

    An axis with several drives has no single input.
    """
    name = next(a.drive for a in stage.axes if a.name == axis)
    if name is None:
        return None
    drive = stage.drive(name)
    chain = drive.tangent(drive.preload.force if drive.preload else 0.0)
    limits = [chain] if chain else []
    if isinstance(drive, PiezoStack) and drive.blocking_force is not None:
        limits.append(drive.blocking_force / drive.free_stroke)
    return min(limits, default=None)


def published_targets(stage: Stage, known: Collection[tuple[str, str]]) -> tuple[Requirement, ...]:
    """Return published finite-element values of a stage as values to match.

    Input displacements are omitted, and values that follow from others: ratio and resolution, if
    the displacement is published.

    Raises
    ------
    ModelError
        No such values were published.

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
            f"there are no published finite-element values of {stage.name}: name values to match, "
            'such as --match "natural_frequency.x = 320 Hz"'
        )
    return targets


def default_variables(template: StageTemplate) -> tuple[Variable, ...]:
    """Return the dimensions that are varied by default: those of the flexure.

    Dimensions of bought parts and bolts, and the plate thickness, are fixed.

    Examples
    --------
    >>> [variable.name for variable in default_variables(StageTemplate.of("parallelogram"))][:2]
    ['leg_spacing', 'leg.notch.neck_thickness']
    """
    return tuple(v for v in every_variable(template, SHARE) if not _is_fixed(v.name))


def free_variables(template: StageTemplate) -> tuple[Variable, ...]:
    """Return the dimensions that a reconstruction frees by default, by 20 % to either side.

    They are those of `default_variables` and the plate thickness.

    Examples
    --------
    >>> variables = free_variables(StageTemplate.of("parallelogram"))
    >>> [v.range_text for v in variables if v.name == "thickness"]
    ['6.4..9.6 mm']
    """
    return tuple(v for v in every_variable(template) if v.name == _PLATE or not _is_fixed(v.name))


def fixed_dimensions_note(template: StageTemplate) -> str:
    """Return the dimensions that `default_variables` omits, as a note; empty if there are none."""
    names = [
        v.name
        for v in every_variable(template, SHARE)
        if _is_fixed(v.name) and not is_data_sheet(v.name)
    ]
    if not names:
        return ""
    return (
        "fixed dimensions of bought parts, bolts and the plate (--over NAME=RANGE varies one): "
        f"{', '.join(names)}"
    )


def _is_fixed(name: str) -> bool:
    return name == _PLATE or any(word in name for word in _BOUGHT)
