"""What a rotary table needs of the stage that centres its scale, and which stages have it."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

from flexstage.base.errors import FlexstageError
from flexstage.centring.error_budget import (
    ReadingError,
    allowed_eccentricity,
    code_limit,
    contributions,
    expanded_uncertainty,
)
from flexstage.centring.table_file import RotaryTable
from flexstage.files.plain import picked
from flexstage.files.result import Result
from flexstage.quantities.quantity import number
from flexstage.stage import Stage
from flexstage.stage.assumptions import CONVERTER_BITS
from flexstage.stage.designs import DESIGNS, design, find_stage
from flexstage.stage.mass import mass_properties
from flexstage.stage.shapes import body_shapes
from flexstage.studies.models import analyse_model
from flexstage.studies.requests import ScaleRequest
from flexstage.system import Analysis

#: Share of the allowed eccentricity that steps of the two axes together, and forces of rotation,
#: may take.
STEP_SHARE, ROTATION_SHARE = 0.5, 0.1
#: Share of its stroke that an elastic drive may lose to an optimised stage.
_LOST_STROKE = 0.1
#: Axes of a stage that moves a scale in its plane.
_PLANAR = {"x", "y"}


@dataclass(frozen=True, slots=True, kw_only=True)
class Need:
    """A requirement on a stage, and what a stage has."""

    what: str
    """What is required."""
    axis: str
    """Axis; empty for the whole stage."""
    unit: str
    """SI unit."""
    limit: float
    """Required value."""
    least: bool
    """True if the value must not be smaller, False if it must not be larger."""
    value: float | None = None
    """Value of the stage; None where it is not known."""

    @property
    def met(self) -> bool:
        """Whether the stage has it."""
        if self.value is None:
            return False
        return self.value >= self.limit if self.least else self.value <= self.limit

    @property
    def margin(self) -> float | None:
        """Value over limit, or limit over value, above 1 if it is met [1]."""
        if not self.value:
            return None
        return self.value / self.limit if self.least else self.limit / self.value

    def text(self) -> str:
        """Return the requirement with the value of the stage in words."""
        name = f"{self.what} {self.axis}".strip()
        limit = displayed(self.limit, self.unit)
        if self.value is None:
            return f"{name} is not known, {limit} needed"
        return f"{name} {displayed(self.value, self.unit)}, {limit} {self._side}"

    @property
    def _side(self) -> str:
        return "needed" if self.least else "allowed"


#: Printed unit and its size, by SI unit.
_UNITS = {"m": ("µm", 1e6), "N/m": ("N/µm", 1e-6), "kg": ("g", 1e3)}


def displayed(value: float, unit: str) -> str:
    """Return a value in its printed unit; lengths above a millimetre in millimetres."""
    name, factor = ("mm", 1e3) if unit == "m" and abs(value) >= 1e-3 else _UNITS[unit]
    return f"{number(factor * value, 3)} {name}"


@dataclass(frozen=True, slots=True, kw_only=True)
class JudgedStage:
    """A stage against the needs of a table."""

    name: str
    """Name of the stage."""
    needs: tuple[Need, ...] = ()
    """The needs with its values."""
    turned_zero: float | None = None
    """Rotation of the scale by a full stroke, which shifts its zero [rad]."""
    problem: str = ""
    """Why it cannot be judged."""

    @property
    def suits(self) -> bool:
        """Whether it meets every need."""
        return not self.problem and all(need.met for need in self.needs)

    @property
    def reason(self) -> str:
        """Return why it does not suit, or its smallest margin."""
        if self.problem:
            return self.problem
        missed = [need for need in self.needs if not need.met]
        if missed:
            return "; ".join(need.text() for need in missed)
        margins = [(need.margin, need) for need in self.needs if need.margin is not None]
        if not margins:
            return ""
        margin, closest = min(margins, key=lambda pair: pair[0])
        return f"smallest margin {number(margin, 3)}: {closest.text()}"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ScaleStudy(Result):
    """Error budget of a table, and stages that can centre its scale."""

    table_key: ClassVar[str] = "contributions"

    table: RotaryTable
    """The table."""
    model: str
    """Model of the stages."""
    mounted: tuple[ReadingError, ...]
    """Contributions with the scale as mounted."""
    centred: tuple[ReadingError, ...]
    """The same with the allowed eccentricity."""
    allowed: float
    """Largest eccentricity after centring [m]."""
    needs: tuple[Need, ...]
    """What every stage needs, apart from what depends on its own mass."""
    stages: tuple[JudgedStage, ...]
    """The stages, in the order of the request."""
    notes: tuple[str, ...]
    """Remarks."""

    def data(self) -> dict[str, Any]:
        reading = self.table.tolerance.reading
        rows = [
            {
                **picked(before, "cause", "order", "distribution", "each", "mean"),
                "centred": after.mean if reading == "mean" else after.each,
                "unit": "rad",
            }
            for before, after in zip(self.mounted, self.centred, strict=True)
        ]
        return {
            "table": self.table.name,
            "model": self.model,
            "contributions": rows,
            "expanded_uncertainty": {
                "mounted": expanded_uncertainty(self.table, self.table.scale.eccentricity),
                "centred": expanded_uncertainty(self.table, self.allowed),
                "tolerance": self.table.tolerance.error,
                "reading": reading,
                "unit": "rad",
            },
            "allowed_eccentricity": {"value": self.allowed, "unit": "m"},
            "needs": [_need_data(need) for need in self.needs],
            "stages": [
                {
                    "stage": judged.name,
                    "suits": judged.suits,
                    "reason": judged.reason,
                    "needs": [_need_data(need) for need in judged.needs],
                    "turned_zero": judged.turned_zero,
                }
                for judged in self.stages
            ],
            "notes": list(self.notes),
        }


def _need_data(need: Need) -> dict[str, Any]:
    return picked(need, "what", "axis", "limit", "value", "unit", "met") | {
        "side": "least" if need.least else "largest"
    }


def planar_designs() -> list[str]:
    """Return the built-in designs that move along x and y."""
    axes = {name: {axis.name for axis in design(name).axes} for name in sorted(DESIGNS)}
    return [name for name, moved in axes.items() if moved >= _PLANAR]


def study_scale(table: RotaryTable, request: ScaleRequest) -> ScaleStudy:
    """Return the error budget of a table, the needs of its stage, and the stages judged by them.

    Parameters
    ----------
    table : RotaryTable
        The table.
    request : ScaleRequest
        The stages and their model.

    Returns
    -------
    ScaleStudy
        The budget and the judged stages.

    Raises
    ------
    ModelError
        Errors other than eccentricity exceed the tolerance.

    Notes
    -----
    Validity: that of `flexstage.centring.error_budget.contributions`; stages begin with both axes
    in the middle of their strokes, the axis of rotation passes through the mean of the points at
    which probes read the body that carries the scale, and forces of rotation act on that body.
    """
    allowed = allowed_eccentricity(table)
    stages = [find_stage(name) for name in request.stage or planar_designs()]

    def judged(stage: Stage) -> JudgedStage:
        try:
            return judge(table, allowed, analyse_model(stage, request.model))
        except FlexstageError as error:
            return JudgedStage(name=stage.name, problem=str(error))

    mounted = contributions(table, table.scale.eccentricity)
    return ScaleStudy(
        request=request,
        table=table,
        model=request.model,
        mounted=mounted,
        centred=contributions(table, allowed),
        allowed=allowed,
        needs=tuple(common_needs(table, allowed)),
        stages=tuple(map(judged, stages)),
        notes=tuple(_notes(table, allowed, stages)),
    )


def common_needs(table: RotaryTable, allowed: float) -> Iterator[Need]:
    """Return what any stage needs; `allowed` is the eccentricity after centring [m].

    From the middle of its stroke each axis must reach the eccentricity to either side. Both axes
    round to their nearest step: half a step of each is 1 / sqrt(2) of a step together.
    """
    before, space = table.scale.eccentricity, table.space
    yield Need(what="stroke", axis="x, y", unit="m", limit=2.0 * before, least=True)
    step = math.sqrt(2.0) * STEP_SHARE * allowed
    yield Need(what="step", axis="x, y", unit="m", limit=step, least=False)
    for what, limit, unit in (
        ("circle about the axis", space.diameter, "m"),
        ("thickness", space.height, "m"),
        ("mass", space.mass, "kg"),
    ):
        if limit is not None:
            yield Need(what=what, axis="", unit=unit, limit=limit, least=False)
    if space.hole is not None:
        yield Need(what="hole about the axis", axis="", unit="m", limit=space.hole, least=True)


#: Figures of a stage by the need that they must meet.
_FIGURES = {
    "stroke": ("output_displacement",),
    "step": ("resolution",),
    "circle about the axis": ("width", "height"),
    "thickness": ("thickness",),
    "mass": ("mass",),
}


def needs_as_constraints(table: RotaryTable, stage: Stage) -> Iterator[tuple[str, str]]:
    """Return the needs of a table as figures and constraints of an optimisation of a stage.

    An elastic drive may lose a tenth of its stroke, which is added to the stroke. Width and
    height within the diameter of the circle do not yet put the corners inside it.
    """
    for need in common_needs(table, allowed_eccentricity(table)):
        for quantity in _FIGURES.get(need.what, ()):
            sign = ">=" if need.least else "<="
            for axis in ("x", "y") if need.axis else ("",):
                limit = need.limit
                spring = _spring(stage, axis) if need.what == "stroke" else None
                if spring:
                    limit /= 1.0 - _LOST_STROKE
                    most = spring * _LOST_STROKE / (1.0 - _LOST_STROKE)
                    yield "input_stiffness", f"input_stiffness.{axis} <= {most!r} N/m"
                end = f".{axis}" if axis else ""
                yield quantity, f"{quantity}{end} {sign} {limit!r} {need.unit}"


def _spring(stage: Stage, axis: str) -> float | None:
    """Return the stiffness of the single drive of an axis [N/m]; None if it is rigid."""
    drives = {a.name: a.drive for a in stage.axes}
    return None if drives.get(axis) is None else stage.drive_of(axis).mounted.stiffness


def judge(table: RotaryTable, allowed: float, analysis: Analysis) -> JudgedStage:
    """Return a stage against the needs of a table."""
    name = analysis.stage.name
    figures = {(c.quantity, c.axis): c.value for c in analysis.characteristics}
    axes = sorted(_PLANAR & {a.axis for a in analysis.axes})
    if len(axes) < len(_PLANAR):
        return JudgedStage(name=name, problem="it does not move along x and y")
    carrier = _carrier(analysis)
    if carrier is None:
        return JudgedStage(name=name, problem="no body is moved by both axes: it is several plates")
    centre = _axis_point(analysis.stage, carrier)
    circle, hole = _circles(analysis.stage, centre)
    of_stage = {
        "circle about the axis": circle,
        "thickness": analysis.stage.thickness,
        "mass": figures.get(("mass", "stage")),
        "hole about the axis": hole,
    }
    needs: list[Need] = []
    for need in common_needs(table, allowed):
        if not need.axis:
            needs.append(_with(need, "", of_stage[need.what]))
            continue
        for axis in axes:
            value = _stroke(analysis.stage, figures, axis)
            if need.what == "step" and value is not None:
                value = figures.get(("resolution", axis), value / 2**CONVERTER_BITS)
            needs.append(_with(need, axis, value))
    needs += _rotation(table, allowed, analysis, figures, centre, axes)
    turned = [
        abs(figures[("parasitic_rotation", a)])
        for a in axes
        if ("parasitic_rotation", a) in figures
    ]
    return JudgedStage(name=name, needs=tuple(needs), turned_zero=max(turned, default=None))


def _stroke(stage: Stage, figures: dict[tuple[str, str], float], axis: str) -> float | None:
    """Return the stroke of an axis [m], less the compression of an elastic drive."""
    working = figures.get(("working_displacement", axis))
    if working is not None:
        return abs(working)
    stroke = figures.get(("output_displacement", axis))
    if stroke is None:
        return None
    spring = _spring(stage, axis)
    share = spring / (spring + figures["input_stiffness", axis]) if spring else 1.0
    return share * abs(stroke)


def _with(need: Need, axis: str, value: float | None) -> Need:
    return Need(
        what=need.what, axis=axis, unit=need.unit, limit=need.limit, least=need.least, value=value
    )


def _carrier(analysis: Analysis) -> str | None:
    """Return the body that both axes move and a probe reads, which carries the scale, or None."""
    moved = [a.static.body_motion for a in analysis.axes if a.axis in _PLANAR]
    ways = {
        body: min(math.hypot(*motion[body][:2]) for motion in moved)
        for body in dict.fromkeys(probe.body for probe in analysis.stage.probes)
    }
    body = max(ways, key=ways.__getitem__)
    least = 0.1 * min(abs(a.output_displacement) for a in analysis.axes if a.axis in _PLANAR)
    return body if ways[body] > least else None


def _axis_point(stage: Stage, carrier: str) -> tuple[float, float]:
    """Return the point of the axis of rotation: where the carrier is read, its mean [m]."""
    points = [p.at for p in stage.probes if p.body == carrier]
    x, y = (sum(point[k] for point in points) / len(points) for k in (0, 1))
    return x, y


def _circles(stage: Stage, centre: tuple[float, float]) -> tuple[float, float]:
    """Return the diameters of the circles about the axis: around the stage, and free of it [m]."""
    from shapely import Point, unary_union

    plate = unary_union([shape.polygon for shape in body_shapes(stage)[0]])
    axis = Point(*centre)
    corners = (p for part in getattr(plate, "geoms", [plate]) for p in part.exterior.coords)
    return 2.0 * max(math.dist(centre, p) for p in corners), 2.0 * float(plate.distance(axis))


def _rotation(
    table: RotaryTable,
    allowed: float,
    analysis: Analysis,
    figures: dict[tuple[str, str], float],
    centre: tuple[float, float],
    axes: Sequence[str],
) -> Iterator[Need]:
    """Return the stiffness that the forces of rotation need."""
    speed = table.axis.speed
    if not speed:
        return
    moving = [
        p
        for body, p in mass_properties(analysis.stage).items()
        if not analysis.stage.body(body).fixed
    ]
    for k, axis in enumerate(axes):
        # static unbalance of the moving bodies, and of scale and bodies by their displacement
        unbalance = abs(sum(p.mass * (p.centre[k] - centre[k]) for p in moving))
        unbalance += (table.scale.mass + sum(p.mass for p in moving)) * table.scale.eccentricity
        yield Need(
            what="output stiffness",
            axis=axis,
            unit="N/m",
            limit=unbalance * speed**2 / (ROTATION_SHARE * allowed),
            least=True,
            value=figures.get(("output_stiffness", axis)),
        )


def _notes(table: RotaryTable, allowed: float, stages: Sequence[Stage]) -> Iterator[str]:
    scale, heads, axis = table.scale, table.heads, table.axis
    if allowed >= scale.eccentricity:
        yield "the scale as mounted meets the tolerance: it need not be centred"
    if scale.kind == "disc":
        gap = axis.axial + scale.radius * (2.0 * scale.tilt + axis.tilt)
    else:
        gap = 2.0 * (scale.eccentricity + scale.ellipticity)
        gap += axis.radial_synchronous + axis.tilt * axis.overhang
    if heads.gap_change is not None and gap:
        verdict = "within" if gap <= heads.gap_change else "more than"
        yield (
            f"the distance between head and scale changes by {displayed(gap, 'm')} over a turn, "
            f"{verdict} the {displayed(heads.gap_change, 'm')} of the heads"
        )
    if scale.tracks is not None:
        yield (
            f"the tracks of the code agree up to an eccentricity of "
            f"{displayed(code_limit(scale.tracks), 'm')}; displaced tracks within the scale are "
            "not repaired by centring"
        )
    if scale.tilt:
        shim = scale.tilt * (scale.diameter or 2.0 * scale.radius)
        yield (
            "a planar stage does not remove the tilt of the scale: a shim of "
            f"{displayed(shim, 'm')} under one edge does"
        )
    yield (
        "stroke: from the middle of both axes the eccentricity as mounted to either side; step: "
        f"{100.0 * STEP_SHARE:.0f} % of the allowed eccentricity, both axes together, that of a "
        f"stack with {CONVERTER_BITS} bits over its stroke where no other is given"
    )
    coupled = [stage.name for stage in stages if any(axis.drives for axis in stage.axes)]
    if coupled:
        yield f"drives that move an axis together ({', '.join(coupled)}): the stroke without load"
