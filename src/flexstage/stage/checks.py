"""Checks of the geometry and the mechanism of a stage, before it is computed or cut."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from flexstage.base.errors import StageError
from flexstage.quantities.characteristic import WHOLE_STAGE
from flexstage.stage.contour import hinge_root, short_halves
from flexstage.stage.drive import Drive, Force
from flexstage.stage.model import Body, Hinge, Issue, Stage, millimetres
from flexstage.stage.narrowest import overlaps, slots_between, slots_within, wall_of
from flexstage.stage.shapes import Shape, body_shapes, notch_shapes, ring

#: Largest distance of a drive or probe from its body [m].
ON_BODY = 10e-6
# how deep under the surface the material is looked for that a drive pushes on [m]
_INTO_BODY = 50e-6
# bodies of plates that are cut by wire are smaller [m]
_LARGEST = 2.0
# a wall thinner than this part of the thinnest neck that can be cut breaks when it is cut
_BREAKS = 0.1


def check(stage: Stage) -> tuple[Issue, ...]:
    """Check the geometry and the mechanism of a stage.

    Parameters
    ----------
    stage : Stage
        The stage.

    Returns
    -------
    tuple of Issue
        Errors first; empty if there are none.

    Notes
    -----
    Outlines with arcs are compared as polygons that deviate by 0.5 um, so overlaps less than 2 um
    deep are not seen. An issue that follows from another one is not reported again.

    Examples
    --------
    >>> from flexstage.quantities.material import material
    >>> from flexstage.stage import Body, Loop
    >>> plate = Loop(((0.0, 0.0), (0.03, 0.0), (0.03, 0.02), (0.0, 0.02)))
    >>> stage = Stage(name="plate", thickness=0.01, material=material("Al 7075-T6"),
    ...               bodies=(Body(name="plate", outline=plate),))
    >>> [issue.code for issue in check(stage)]
    ['no-fixed-body']
    """
    bodies, issues = body_shapes(stage)
    sound = {s.name for s in bodies}
    rooted: list[Hinge] = []
    for hinge in stage.hinges:
        hinge_issues = list(_hinge(stage, hinge, sound))
        issues += hinge_issues
        if sound.issuperset(hinge.bodies) and not any(
            f.code == "root-off-body" for f in hinge_issues
        ):
            rooted.append(hinge)
    shapes = [*bodies, *notch_shapes(rooted)]
    overlapping = list(overlaps(shapes))
    issues += overlapping
    wire = stage.manufacture.wire_width
    # a notch that is too short, or not where it should be, puts its bodies too close as well
    skip = {frozenset(f.what) for f in overlapping}
    skip |= {
        frozenset(h.bodies) for h in stage.hinges if h not in rooted or h.profile.length < wire
    }
    issues += slots_between(shapes, wire, skip)
    for body in stage.bodies:
        if body.name in sound:
            issues += slots_within(body, wire)
    for body, shape in zip((b for b in stage.bodies if b.name in sound), bodies, strict=True):
        issues += _wall(stage, body, shape)
    sides = [np.ptp(np.reshape(s.polygon.bounds, (2, 2)), axis=0).max() for s in bodies]
    if (largest := max(sides, default=0.0)) > _LARGEST:
        issues.append(
            _warning(
                "size",
                (WHOLE_STAGE,),
                f"the stage has a body of {largest:.4g} m: check the length_unit of the file, or "
                "the units of its sizes",
            )
        )
    for name, share in short_halves(stage).items():
        issues.append(
            _warning(
                "early-root",
                (name,),
                f"the contour of hinge '{name}' is almost parallel to its root from "
                f"{100.0 * share:.0f} % of half its length on, so that in finite elements what "
                "remains is of its body, which is rigid or of another material: make the notch "
                "longer or less deep",
            )
        )
    issues += _mechanism(stage)
    by_name = {s.name: s for s in bodies}
    for drive in stage.drives:
        issues += _drive(stage, drive, by_name)
    issues += _probes(stage, sound)
    issues += _published(stage)
    return tuple(sorted(issues, key=lambda f: f.severity != "error"))


def _error(code: str, what: tuple[str, ...], message: str) -> Issue:
    return Issue(severity="error", code=code, what=what, message=message)


def _warning(code: str, what: tuple[str, ...], message: str) -> Issue:
    return Issue(severity="warning", code=code, what=what, message=message)


def _hinge(stage: Stage, hinge: Hinge, sound: set[str]) -> Iterator[Issue]:
    profile, limits = hinge.profile, stage.manufacture
    if profile.neck_thickness < limits.minimum_neck * (1.0 - 1e-9):
        yield _error(
            "thin-neck",
            (hinge.name,),
            f"the neck of hinge '{hinge.name}' is {millimetres(profile.neck_thickness)} thick, "
            "below the minimum neck of the manufacturing process, "
            f"{millimetres(limits.minimum_neck)}",
        )
    if profile.neck_thickness > stage.thickness:
        yield _warning(
            "thick-neck",
            (hinge.name,),
            f"the neck of hinge '{hinge.name}' ({millimetres(profile.neck_thickness)}) is thicker "
            f"than the plate ({millimetres(stage.thickness)}), so it bends out of the plane first",
        )
    if profile.length < limits.wire_width * (1.0 - 1e-9):
        yield _error(
            "narrow-notch",
            (hinge.name,),
            f"the notch of hinge '{hinge.name}' is {millimetres(profile.length)} long, less than "
            f"the wire width of {millimetres(limits.wire_width)}",
        )
    elif 0.0 < profile.neck_radius < 0.5 * limits.wire_width * (1.0 - 1e-9):
        yield _error(
            "narrow-notch",
            (hinge.name,),
            f"the notch of hinge '{hinge.name}' has a radius of "
            f"{millimetres(profile.neck_radius)}, less than half of the wire "
            f"width of {millimetres(limits.wire_width)}",
        )
    yield from _roots(stage, hinge, sound)


def _roots(stage: Stage, hinge: Hinge, sound: set[str]) -> Iterator[Issue]:
    def faults(trial: Hinge) -> list[Issue]:
        issues = []
        for which in (0, 1):
            body = trial.bodies[which]
            if body in sound:
                try:
                    hinge_root(stage, trial, which)
                except StageError as error:
                    issues.append(_error("root-off-body", (trial.name, body), str(error)))
        return issues

    root_issues = faults(hinge)
    a, b = hinge.bodies
    if len(root_issues) == 2 and not faults(replace(hinge, bodies=(b, a))):
        yield _error(
            "root-off-body",
            (hinge.name, a, b),
            f"hinge '{hinge.name}' points from body '{b}' to body '{a}', but its bodies are "
            f"'{a}', '{b}': reverse its direction (180 deg), or name the bodies as '{b}', '{a}'",
        )
    else:
        yield from root_issues


def _wall(stage: Stage, body: Body, shape: Shape) -> Iterator[Issue]:
    limit = stage.manufacture.minimum_neck
    # a hole that touches the outline may cut the body into two
    connected = shape.polygon.geom_type == "Polygon"
    wall = wall_of(body, shape.polygon, limit) if connected else 0.0
    if wall >= limit * (1.0 - 1e-9):
        return
    breaks = wall < _BREAKS * limit
    yield (_error if breaks else _warning)(
        "thin-wall",
        (body.name,),
        f"the thinnest wall of body '{body.name}', between its holes, mounting holes and outline, "
        f"is {millimetres(max(wall, 0.0))}, "
        + (
            "less than a tenth of the minimum neck of the manufacturing process, "
            f"{millimetres(limit)}, and will break: make the wall thicker, or remove it"
            if breaks
            else f"below the minimum neck of the manufacturing process, {millimetres(limit)}: make "
            "it thicker"
        ),
    )


def _mechanism(stage: Stage) -> Iterator[Issue]:
    if not any(b.fixed for b in stage.bodies):
        yield _error(
            "no-fixed-body",
            (),
            "no body is fixed, so the stage is not constrained: set 'fixed: true' on the body "
            "that is bolted down",
        )
        return
    connected = reachable_bodies(stage)
    loose = tuple(b.name for b in stage.bodies if b.name not in connected)
    if loose:
        yield _error(
            "unconnected-body",
            loose,
            f"no chain of hinges connects {_list('body', loose)} to a fixed body: add hinges, or "
            "fix what is bolted down",
        )
        return
    yield from _freedom(stage)


def _freedom(stage: Stage) -> Iterator[Issue]:
    # without a drive the free motions are what the stage is for
    if not stage.drives:
        return
    motion = free_motion(stage)
    if not motion.freedoms:
        return
    platforms = {p.body for p in stage.probes}
    ends = {d.pushes for d in stage.drives} | {d.reacts for d in stage.drives}
    dangling = tuple(
        b.name
        for b in stage.bodies
        if b.name in motion.bodies
        and b.name not in platforms | ends
        and sum(b.name in h.bodies for h in stage.hinges) == 1
    )
    motions = []
    if motion.turning:
        motions.append(f"{_list('body', motion.turning)} can rotate")
    if motion.shifting:
        motions.append(f"{_list('body', motion.shifting)} can translate")
    several = "s" if motion.freedoms > 1 else ""
    count = f"{motion.freedoms} degree{several} of freedom"
    text = (
        f"with all drives locked, the mechanism keeps {count}: {' and '.join(motions)}, resisted "
        "only by the bending of hinges"
    )
    if dangling:
        yield _error(
            "free-motion",
            motion.bodies,
            f"{text}; {_list('body', dangling)} hangs by a single hinge and guides nothing: add "
            "the missing hinge",
        )
    elif platforms & set(motion.bodies):
        yield _error(
            "free-motion", motion.bodies, f"{text}: add the missing hinges, legs or drives"
        )
    else:
        # the inner stage of a double parallelogram is like that, and meant to be
        yield _warning("free-motion", motion.bodies, text)


def _drive(stage: Stage, drive: Drive, shapes: dict[str, Shape]) -> Iterator[Issue]:
    from shapely import Point

    name = drive.name
    if drive.pushes == drive.reacts:
        yield _error(
            "drive-on-one-body",
            (name, drive.pushes),
            f"drive '{name}' pushes body '{drive.pushes}' and also reacts on it, so it moves "
            "nothing",
        )
        return
    if stage.body(drive.pushes).fixed and stage.body(drive.reacts).fixed:
        yield _error(
            "drive-between-fixed-bodies",
            (name, drive.pushes, drive.reacts),
            f"drive '{name}' acts between the fixed bodies '{drive.pushes}' and '{drive.reacts}', "
            "so it moves nothing",
        )
        return
    off = False
    verbs = ("pushes", "stands on")
    for verb, body, at in zip(verbs, (drive.pushes, drive.reacts), drive.at, strict=True):
        if body not in shapes:
            off = True
            continue
        distance = shapes[body].polygon.boundary.distance(Point(at))
        if distance > ON_BODY:
            off = True
            yield _error(
                "drive-off-body",
                (name, body),
                f"drive '{name}' {verb} body '{body}' at {millimetres(*at)}, which is "
                f"{millimetres(distance)} away from the edge of that body: move the point onto it",
            )
    # a voice coil pulls as well as it pushes, and has no contact
    if off or isinstance(drive, Force):
        return
    c, s = math.cos(drive.direction), math.sin(drive.direction)
    x, y = drive.at[0]
    inside = shapes[drive.pushes].polygon.buffer(ON_BODY)
    if not inside.contains(Point(x + _INTO_BODY * c, y + _INTO_BODY * s)):
        yield _warning(
            "drive-pulls",
            (name, drive.pushes),
            f"drive '{name}' acts away from body '{drive.pushes}' instead of into it, and a "
            f"{drive.kind} cannot pull: reverse its direction, or push on the other side",
        )
    dx, dy = x - drive.at[1][0], y - drive.at[1][1]
    # with an offset within the patch the two contacts still face each other
    if abs(dx * s - dy * c) > drive.patch_half_width:
        yield _warning(
            "drive-askew",
            (name,),
            f"the two points of drive '{name}' are offset by {millimetres(abs(dx * s - dy * c))} "
            "across its direction, more than the half-width of its patch "
            f"({millimetres(drive.patch_half_width)}): the models use the line through the pushed "
            "point for push and reaction, so move one of the points",
        )


def _probes(stage: Stage, sound: set[str]) -> Iterator[Issue]:
    from shapely import Point

    insides = {b.name: ring(b.outline) for b in stage.bodies if b.name in sound}
    for probe in stage.probes:
        body, at = stage.body(probe.body), Point(probe.at)
        if body.name in sound:
            # what is read may be mounted over an opening of the body, but not where the opening
            # holds another body
            inner = [
                name
                for name, inside in insides.items()
                if inside.area < insides[body.name].area and inside.contains(at)
            ]
            distance = insides[body.name].distance(at)
            if distance > ON_BODY or inner:
                where = (
                    f"on body '{inner[0]}'"
                    if inner
                    else f"{millimetres(distance)} outside its outline"
                )
                yield _error(
                    "probe-off-body",
                    (probe.name, body.name),
                    f"probe '{probe.name}' reads body '{body.name}' at {millimetres(*probe.at)}, "
                    f"which is {where}: move the point onto the body to be measured",
                )
        if body.fixed and probe.relative_to is None:
            yield _warning(
                "probe-on-fixed-body",
                (probe.name, body.name),
                f"probe '{probe.name}' reads body '{body.name}', which is fixed, so it always "
                "reads 0",
            )


def _list(noun: str, names: tuple[str, ...]) -> str:
    """Return a noun and names: "body 'a'", "bodies 'a', 'b' and 3 more"."""
    listed = ", ".join(f"'{n}'" for n in names[:4])
    more = f" and {len(names) - 4} more" if len(names) > 4 else ""
    plural = noun[:-1] + "ies" if len(names) > 1 and noun.endswith("y") else noun
    return f"{plural} {listed}{more}"


def _published(stage: Stage) -> Iterator[Issue]:
    axes = {axis.name for axis in stage.axes}
    for name in sorted({row.axis for row in stage.published} - axes - {WHOLE_STAGE}):
        yield _warning(
            "published-axis",
            (name,),
            f"a published figure refers to axis '{name}', which the stage does not have (it has "
            f"{', '.join(sorted(axes)) or 'none'}), so the figure is not compared",
        )


# singular values below this, relative to the largest, are motions without strain
_RANK = 1e-8
# a body that moves less than this, relative to the one that moves most, stands still
_STILL = 1e-6


@dataclass(frozen=True, slots=True, kw_only=True)
class FreeMotion:
    """Motions of a stage with locked drives."""

    freedoms: int
    """Number of independent motions."""
    turning: tuple[str, ...]
    """Bodies that mainly rotate."""
    shifting: tuple[str, ...]
    """Bodies that mainly translate."""

    @property
    def bodies(self) -> tuple[str, ...]:
        """All bodies that move."""
        return (*self.turning, *self.shifting)


def reachable_bodies(stage: Stage) -> set[str]:
    """Return the bodies that hinges connect to a fixed one."""
    neighbours: dict[str, set[str]] = {b.name: set() for b in stage.bodies}
    for hinge in stage.hinges:
        a, b = hinge.bodies
        neighbours[a].add(b)
        neighbours[b].add(a)
    reached: set[str] = set()
    waiting = [b.name for b in stage.bodies if b.fixed]
    while waiting:
        name = waiting.pop()
        if name not in reached:
            reached.add(name)
            waiting += neighbours[name] - reached
    return reached


def free_motion(stage: Stage, *, hold_drives: bool = True) -> FreeMotion:
    """Find the motions that the hinges, taken as pins, leave free.

    Bodies that hinges do not connect to a fixed one are excluded; with `hold_drives` each drive
    keeps its length.

    Notes
    -----
    Small motions: the null space of the matrix that gives the motion at each neck of body b against
    body a, and the change in length of each drive.

    Validity: plane motion, small displacement.
    """
    connected = reachable_bodies(stage)
    moving = [b for b in stage.bodies if not b.fixed and b.name in connected]
    if not moving:
        return FreeMotion(freedoms=0, turning=(), shifting=())
    first = {b.name: 3 * k for k, b in enumerate(moving)}
    corners = np.concatenate([np.array(b.outline.points) for b in stage.bodies])
    scale = float(np.ptp(corners, axis=0).max())
    centres = {b.name: np.array(b.outline.points).mean(axis=0) for b in moving}

    def motion_at(body: str, point: tuple[float, float]) -> NDArray[np.float64]:
        """Displacement of a point of a body per coordinate; rotations are scaled to lengths."""
        out = np.zeros((2, 3 * len(moving)))
        if body in first:
            k = first[body]
            x, y = (np.array(point) - centres[body]) / scale
            out[:, k : k + 3] = [[1.0, 0.0, -y], [0.0, 1.0, x]]
        return out

    rows = [
        motion_at(h.bodies[1], h.at) - motion_at(h.bodies[0], h.at)
        for h in stage.hinges
        if h.bodies[0] in connected
    ]
    if hold_drives:
        for d in stage.drives:
            along = np.array([[np.cos(d.direction), np.sin(d.direction)]])
            rows.append(along @ (motion_at(d.pushes, d.at[0]) - motion_at(d.reacts, d.at[0])))
    _, values, basis = np.linalg.svd(np.concatenate(rows), full_matrices=True)
    rank = int(np.sum(values > _RANK * values[0]))
    free = basis[rank:]
    turning, shifting = [], []
    largest = float(np.abs(free).max(initial=0.0))
    for body in moving:
        part = free[:, first[body.name] : first[body.name] + 3]
        shift = float(np.linalg.norm(part[:, :2]))
        size = float(np.ptp(np.array(body.outline.points), axis=0).max())
        turn = float(np.linalg.norm(part[:, 2])) * size / scale
        if max(shift, turn) > _STILL * largest:
            (turning if turn > shift else shifting).append(body.name)
    return FreeMotion(freedoms=len(free), turning=tuple(turning), shifting=tuple(shifting))
