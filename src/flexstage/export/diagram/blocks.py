"""Bodies, hinges, drives and probes of a structural diagram.

A body is a sum of forces, an inverse mass, and two integrators. A hinge turns the motion of two
bodies into forces on both; a drive acts and a probe reads along a line.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from flexstage.base.arrays import Array
from flexstage.export.diagram.graph import DiagramBuilder, GroupBuilder
from flexstage.hysteresis import Amplifier, Creep, HysteresisModel
from flexstage.hysteresis.dynamic_model import DynamicModel, ModelDrive, ModelProbe
from flexstage.lumped import Mechanism, Sight
from flexstage.lumped.rigid_bodies import SpringHinge
from flexstage.system import RayleighDamping, modes


@dataclass(frozen=True, slots=True, kw_only=True)
class DriveSpring:
    """Spring between the free displacement of a drive and the stage."""

    stiffness: float
    """Stiffness [N/m]; 0 for a drive that is a pure force."""
    replaces_imposed: bool = False
    """Replacement of an imposed displacement."""
    own_frequency_hz: float = 0.0
    """Approximate frequency of the additional mode of a replacement [Hz]. At a frequency f the
    error of the displacement is (f/own_frequency_hz)^2.
    """


@dataclass(frozen=True, slots=True, kw_only=True)
class BodyBlocks:
    """Connections of a body for other groups."""

    forces: str
    """Name of the sum of forces."""
    rate: str
    """Name of the integrator of the rates."""
    motion: str
    """Name of the integrator of the displacement."""
    name: str
    """Name of the body."""


def add_body(
    builder: DiagramBuilder, mechanism: Mechanism, index: int, damping: RayleighDamping
) -> BodyBlocks:
    """Add the group of a body."""
    body = mechanism.bodies[index]
    words = f"body {body.name}"
    group = builder.group(f"b_{body.name}", title=f"Body {body.name}", kind="body")
    masses = np.array([body.mass, body.mass, body.inertia])
    forces = group.sum("forces", f"forces on {words} [N, N, N m]", masses.size)
    inverse = group.gain(
        "inverse_mass",
        "M⁻¹",
        f"inverse masses and inertia of {words} [1/kg, 1/kg, 1/(kg m^2)]",
        np.diag(1.0 / masses),
        "mass",
    )
    rate = group.integrator("rate", f"rates of {words} [m/s, m/s, rad/s]", masses.size)
    centre = f"displacement of the centre of mass and rotation of {words} [m, m, rad]"
    motion = group.integrator("motion", centre, masses.size)
    builder.connect(forces, inverse, f"F_{body.name} [N, N, N m]")
    builder.chain(inverse, rate, motion)
    if damping.alpha > 0.0:
        meaning = f"damping of {words} against the ground [N s/m, N s/m, N m s]"
        drag = group.gain("damper", "αM", meaning, np.diag(damping.alpha * masses), "damper")
        builder.connect(rate, drag)
        builder.term(forces, drag, -1, last=True)
    return BodyBlocks(forces=forces, rate=rate, motion=motion, name=body.name)


def point_of_body(mechanism: Mechanism, body: int, at: tuple[float, float]) -> Array:
    """Return the matrix of motion (x, y, rotation) of a point [m] of a body, shape (3, 3)."""
    cx, cy = mechanism.bodies[body].centre
    return np.array([[1.0, 0.0, -(at[1] - cy)], [0.0, 1.0, at[0] - cx], [0.0, 0.0, 1.0]])


def _hinge_end(mechanism: Mechanism, hinge: SpringHinge, body: int) -> Array:
    """Return the motion of an end of a hinge, in its axes, for the coordinates of the body."""
    c, s = math.cos(hinge.direction), math.sin(hinge.direction)
    return np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]) @ point_of_body(
        mechanism, body, hinge.at
    )


def moving_ends(
    ends: tuple[int, int], bodies: dict[int, BodyBlocks], matrix_of: Callable[[int], Array]
) -> list[tuple[BodyBlocks, int, Array]]:
    """Return the free bodies at two ends with signs and matrices.

    A length or deformation is the sum over the ends of sign times matrix times motion. The second
    body comes first.
    """
    moving = [
        (bodies[body], sign, matrix_of(body))
        for body, sign in zip(ends[::-1], (1, -1), strict=True)
        if body in bodies
    ]
    if len(moving) == 1:
        end, sign, matrix = moving[0]
        return [(end, 1, sign * matrix)]
    return moving


def add_hinge(
    builder: DiagramBuilder,
    mechanism: Mechanism,
    hinge: SpringHinge,
    bodies: dict[int, BodyBlocks],
    damping: RayleighDamping,
) -> None:
    """Add the group of a hinge, and connect its forces to bodies."""
    sides = moving_ends(hinge.bodies, bodies, lambda body: _hinge_end(mechanism, hinge, body))
    if not sides:
        return
    words = f"hinge {hinge.name}"
    fixed_bodies = [mechanism.bodies[i].name for i in hinge.bodies if mechanism.bodies[i].fixed]
    group = builder.group(
        f"h_{hinge.name}",
        title=f"Hinge {hinge.name}" + (f" to {fixed_bodies[0]} (fixed)" if fixed_bodies else ""),
        kind="hinge",
    )
    stiffness = np.asarray(hinge.stiffness)
    meaning = f"stiffness of {words} [N/m, N, N m/rad]"
    spring = group.gain("spring", "K", meaning, stiffness, "spring")
    count = stiffness.shape[0]
    what = f"deformation of {words} [m, m, rad]"
    gains = _add_parts(builder, group, sides, "motion", "B", what)
    from_motion = _add_total(builder, group, gains, "motion", what, count)
    builder.connect(from_motion, spring, f"e_{hinge.name} [m, m, rad]")
    force = spring
    if damping.beta > 0.0:
        meaning = f"damping of {words} [N s/m, N s, N m s/rad]"
        damper = group.gain("damper", "βK", meaning, damping.beta * stiffness, "damper")
        what = f"rate of deformation of {words} [m/s, m/s, rad/s]"
        gains = _add_parts(builder, group, sides, "rate", "B", what)
        builder.connect(_add_total(builder, group, gains, "rate", what, count), damper)
        force = group.sum("force", f"force of {words} [N, N, N m]", count)
        builder.term(force, spring, 1)
        builder.term(force, damper, 1)
    signal = f"f_{hinge.name} [N, N, N m]"
    for number, (end, sign, matrix) in enumerate(sides):
        meaning = f"force of {words} on body {end.name} [N, N, N m]"
        back = group.gain(f"to_{number + 1}", "Bᵀ", meaning, matrix.T.copy(), "geometry")
        builder.connect(force, back, signal if number == 0 else "")
        builder.term(end.forces, back, -sign, signal)


def _add_parts(
    builder: DiagramBuilder,
    group: GroupBuilder,
    sides: list[tuple[BodyBlocks, int, Array]],
    of: str,
    label: str,
    what: str,
) -> list[tuple[str, int]]:
    """Add the parts of a sum by the ``motion`` or ``rate`` of each body, with their signs."""
    gains = []
    for number, (end, sign, matrix) in enumerate(sides):
        meaning = f"part of body {end.name} in the {what}"
        gain = group.gain(f"{of}_{number + 1}", label, meaning, matrix, "geometry")
        if of == "motion":
            builder.connect(end.motion, gain, f"q_{end.name} [m, m, rad]")
        else:
            builder.connect(end.rate, gain, f"q'_{end.name} [m/s, m/s, rad/s]")
        gains.append((gain, sign))
    return gains


def _add_total(
    builder: DiagramBuilder,
    group: GroupBuilder,
    gains: list[tuple[str, int]],
    name: str,
    meaning: str,
    width: int = 1,
) -> str:
    """Add the sum of parts and return its name; a single part is returned as it is."""
    if len(gains) == 1:
        return gains[0][0]
    total = group.sum(name, meaning, width)
    for gain, sign in gains:
        builder.term(total, gain, sign)
    return total


def _line_of_sight(
    mechanism: Mechanism, sight: Sight, bodies: dict[int, BodyBlocks]
) -> list[tuple[BodyBlocks, int, Array]]:
    """Return the bodies at the ends of a drive or probe, with signs and rows of the distance."""
    along = np.array([0.0, 0.0, 1.0])
    if sight.direction is not None:
        along = np.array([math.cos(sight.direction), math.sin(sight.direction), 0.0])

    def row(body: int) -> Array:
        # one line of action through the pushed point, as in the lumped model
        return (along @ point_of_body(mechanism, body, sight.points[1]))[None, :]

    return moving_ends(sight.bodies, bodies, row)


def add_drive(
    builder: DiagramBuilder,
    mechanism: Mechanism,
    sight: Sight,
    bodies: dict[int, BodyBlocks],
    spring: DriveSpring,
    damping: RayleighDamping,
    free: str,
    group: GroupBuilder,
) -> None:
    """Add the spring between the free displacement and the bodies, and its force on them.

    `free` is the block of the free displacement, or of the force if there is no stiffness.
    """
    sides = _line_of_sight(mechanism, sight, bodies)
    force = free
    if spring.stiffness > 0.0:
        force = _add_drive_spring(builder, sight, sides, spring, damping, free, group)
    for number, (end, sign, row) in enumerate(sides):
        meaning = f"force of drive {sight.name} on body {end.name} [N, N, N m]"
        back = group.gain(f"to_{number + 1}", "rᵀ", meaning, row.T.copy(), "geometry")
        builder.connect(force, back, f"F_{sight.name} [N]" if number == 0 else "")
        builder.term(end.forces, back, sign, f"f_{sight.name} [N, N, N m]")


def _add_drive_spring(
    builder: DiagramBuilder,
    sight: Sight,
    sides: list[tuple[BodyBlocks, int, Array]],
    spring: DriveSpring,
    damping: RayleighDamping,
    free: str,
    group: GroupBuilder,
) -> str:
    name = sight.name
    stretch = group.sum("compression", f"free displacement less elongation of drive {name} [m]")
    builder.term(stretch, free, 1, f"w_{name} [m]")
    length = f"length of {name} [m or m/s]"
    for gain, sign in _add_parts(builder, group, sides, "motion", "r", length):
        builder.term(stretch, gain, -sign)
    remark = ", which replaces an imposed displacement" if spring.replaces_imposed else ""
    meaning = f"stiffness of drive {name} [N/m]{remark}"
    stiffness = group.gain("spring", "k", meaning, spring.stiffness, "spring")
    builder.connect(stretch, stiffness)
    if damping.beta == 0.0 or spring.replaces_imposed:
        return stiffness
    force = group.sum("force", f"force of drive {name} [N]")
    builder.term(force, stiffness, 1)
    meaning = f"damping of drive {name} [N s/m]"
    damper = group.gain("damper", "βk", meaning, damping.beta * spring.stiffness, "damper")
    rates = _add_parts(builder, group, sides, "rate", "r", length)
    meaning = f"rate of elongation of drive {name} [m/s]"
    builder.connect(_add_total(builder, group, rates, "rate", meaning), damper)
    builder.term(force, damper, -1)
    return force


def add_reading(
    builder: DiagramBuilder,
    mechanism: Mechanism,
    sight: Sight,
    bodies: dict[int, BodyBlocks],
    group: GroupBuilder,
) -> str:
    """Add the motion at a probe; return its block, empty if no free body is at the probe."""
    sides = _line_of_sight(mechanism, sight, bodies)
    if not sides:
        return ""
    what, unit = ("rotation", "rad") if sight.direction is None else ("length", "m")
    part = f"{what} of probe {sight.name} [{unit} or {unit}/s]"
    gains = _add_parts(builder, group, sides, "motion", "r", part)
    read = "rotation" if sight.direction is None else "distance"
    meaning = f"{read} at probe {sight.name} [{unit}]"
    return _add_total(builder, group, gains, "distance", meaning)


def output_scale(model: DynamicModel, drive: ModelDrive) -> float:
    """Return the free displacement over the output of the hysteresis of a drive.

    It is 1 unless the hysteresis was identified from voltage to reading [m/unit].
    """
    if drive.hysteresis is None or drive.stiffness is None:
        return 1.0
    port = model.system.drive(drive.name)
    in_place = modes(model.system, drives="in place", count=None)
    count = drive.modal_gain.size
    local_gain = (drive.stiffness or 1.0) * (port.vector @ in_place.shapes[:, :count])
    local_gain = local_gain / in_place.omega[:count] ** 2
    at = int(np.argmax(np.abs(local_gain)))
    scale = float(drive.modal_gain[at] / local_gain[at])
    return 1.0 if abs(scale - 1.0) < 1e-9 else scale


def add_drive_chain(
    builder: DiagramBuilder, model: DynamicModel, drive: ModelDrive, group: GroupBuilder
) -> str:
    """Add the chain before the spring of a drive; return the block of w [m], or the force [N]."""
    what = "force" if drive.stiffness == 0.0 else "free displacement"
    unit = "N" if drive.stiffness == 0.0 else "m"
    words = f"{what} of drive {drive.name} [{unit}]"
    signal = f"u_{drive.name} [{drive.unit}]"
    meaning = f"command of drive {drive.name} [{drive.unit}]"
    at = group.add("command", "input", f"u_{drive.name}", meaning, role="drive", unit=drive.unit)
    if drive.amplifier is not None:
        bandwidth = drive.amplifier.bandwidth_hz
        meaning = f"amplifier of drive {drive.name}, {bandwidth:.4g} Hz [V]"
        block = _add_model(group, "amplifier", meaning, drive.amplifier)
        builder.connect(at, block, signal)
        at, signal = block, f"v_{drive.name} [V]"
    if drive.hysteresis is not None:
        meaning = f"hysteresis ({drive.hysteresis.kind}) from voltage [V] to {words}"
        block = _add_model(group, "hysteresis", meaning, drive.hysteresis)
        builder.connect(at, block, signal)
        at, scale = block, output_scale(model, drive)
        if scale != 1.0:
            meaning = f"{words} over output of the identified hysteresis"
            at = builder.chain(at, group.gain("scale", "c", meaning, scale, "drive"))
    elif drive.gain != 1.0 or drive.unit != unit:
        meaning = f"{what} over command of drive {drive.name} [{unit}/{drive.unit}]"
        block = group.gain("gain", "c", meaning, drive.gain, "drive")
        builder.connect(at, block, signal)
        at = block
    if drive.creep is not None:
        percent = 100.0 * drive.creep.rate_per_decade
        meaning = f"creep of the {words}, {percent:.3g} % per decade"
        at = builder.chain(at, _add_model(group, "creep", meaning, drive.creep))
    return at


def _add_model(
    group: GroupBuilder,
    kind: Literal["amplifier", "hysteresis", "creep"],
    meaning: str,
    model: Amplifier | HysteresisModel | Creep,
) -> str:
    return group.add(kind, kind, kind, meaning, model=model, role="drive")


def add_probe_chain(
    builder: DiagramBuilder, probe: ModelProbe, source: str, group: GroupBuilder, signal: str = ""
) -> str:
    """Add the sensor after the true motion [m] at a probe, and the output, which is returned."""
    at = source
    if probe.sensor is not None:
        meaning = f"sensor of probe {probe.name}, without noise [{probe.unit}]"
        block = group.add("sensor", "sensor", "sensor", meaning, model=probe.sensor)
        builder.connect(at, block, signal)
        at, signal = block, ""
    meaning = f"reading of probe {probe.name} [{probe.unit}]"
    out = group.add("reading", "output", f"y_{probe.name}", meaning, unit=probe.unit)
    builder.connect(at, out, signal or f"y_{probe.name} [{probe.unit}]")
    return out
