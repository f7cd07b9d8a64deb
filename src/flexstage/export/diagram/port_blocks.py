"""Drives and probes of a structural diagram: what acts and reads along a line."""

import math

import numpy as np

from flexstage.arrays import Array
from flexstage.export.diagram.body_blocks import BodyBlocks, per_second, point_of_body
from flexstage.export.diagram.graph import DiagramBuilder
from flexstage.export.diagram.springs import DriveSpring
from flexstage.hysteresis.dynamic_model import DynamicModel, ModelDrive, ModelProbe
from flexstage.lumped import Mechanism, Sight
from flexstage.system import RayleighDamping, modes


def _line_of_sight(
    mechanism: Mechanism, sight: Sight, bodies: dict[int, BodyBlocks]
) -> list[tuple[BodyBlocks, int, Array]]:
    """Bodies at the ends of a drive or probe, their signs, and rows of the distance."""
    along = np.array([math.cos(sight.direction), math.sin(sight.direction), 0.0])
    found: list[tuple[BodyBlocks, int, Array]] = []
    for body, sign in zip(sight.bodies[::-1], (1, -1), strict=True):
        if body not in bodies:
            continue
        end = bodies[body]
        # both ends share one line of action, through the pushed point, as in the lumped model
        row = np.zeros((1, 3 * len(end.members)))
        column = 3 * end.members.index(body)
        row[0, column : column + 3] = along @ point_of_body(mechanism, body, sight.points[1])
        found.append((end, sign, row))
    if len(found) == 1:
        end, sign, row = found[0]
        return [(end, 1, sign * row)]
    return found


def add_drive(
    builder: DiagramBuilder,
    mechanism: Mechanism,
    sight: Sight,
    bodies: dict[int, BodyBlocks],
    spring: DriveSpring,
    damping: RayleighDamping,
    free: str,
    group: str,
) -> None:
    """Add the spring between the free displacement and the bodies, and its force on them.

    `free` is the block of the free displacement, or, where there is no stiffness, of the force.
    """
    sides = _line_of_sight(mechanism, sight, bodies)
    force = free
    if spring.stiffness > 0.0:
        force = _add_drive_spring(builder, sight, sides, spring, damping, free, group)
    for number, (end, sign, row) in enumerate(sides):
        back = builder.gain(
            f"{group}_to_{number + 1}",
            "rᵀ",
            f"force of drive {sight.name} on body {end.name} [N, N, N m]",
            row.T.copy(), group, "geometry",
        )  # fmt: skip
        builder.connect(force, back, f"F_{sight.name} [N]" if number == 0 else "")
        builder.term(end.forces, back, sign, f"f_{sight.name} [N, N, N m]")


def _add_drive_spring(
    builder: DiagramBuilder,
    sight: Sight,
    sides: list[tuple[BodyBlocks, int, Array]],
    spring: DriveSpring,
    damping: RayleighDamping,
    free: str,
    group: str,
) -> str:
    stretch = builder.add(
        f"{group}_compression",
        "sum",
        "+",
        f"free displacement less elongation of drive {sight.name} [m]",
        group=group,
    )
    builder.term(stretch, free, 1, f"w_{sight.name} [m]")
    for number, (end, sign, row) in enumerate(sides):
        gain = _add_row(builder, sight.name, end, row, group, f"motion_{number + 1}")
        builder.connect(end.motion, gain, "q" + end.label)
        builder.term(stretch, gain, -sign)
    stands_in = ", which stands in for an imposed displacement" if spring.stands_in else ""
    stiffness = builder.gain(
        f"{group}_spring",
        "k",
        f"stiffness of drive {sight.name} [N/m]{stands_in}",
        spring.stiffness, group, "spring",
    )  # fmt: skip
    builder.connect(stretch, stiffness)
    if damping.beta == 0.0 or spring.stands_in:
        return stiffness
    force = builder.add(
        f"{group}_force", "sum", "+", f"force of drive {sight.name} [N]", group=group
    )
    builder.term(force, stiffness, 1)
    damper = builder.gain(
        f"{group}_damper",
        "βk",
        f"damping of drive {sight.name} [N s/m]",
        damping.beta * spring.stiffness, group, "damper",
    )  # fmt: skip
    rates = [
        (_add_row(builder, sight.name, end, row, group, f"rate_{number + 1}"), end, sign)
        for number, (end, sign, row) in enumerate(sides)
    ]
    for gain, end, _ in rates:
        builder.connect(end.rate, gain, "q'" + per_second(end.label))
    if len(rates) == 1:
        builder.connect(rates[0][0], damper)
    else:
        total = builder.add(
            f"{group}_rate",
            "sum",
            "+",
            f"rate of elongation of drive {sight.name} [m/s]",
            group=group,
        )
        for gain, _, sign in rates:
            builder.term(total, gain, sign)
        builder.connect(total, damper)
    builder.term(force, damper, -1)
    return force


def _add_row(
    builder: DiagramBuilder, sight: str, end: BodyBlocks, row: Array, group: str, what: str
) -> str:
    meaning = f"part of body {end.name} in the length of {sight} [m or m/s]"
    return builder.gain(f"{group}_{what}", "r", meaning, row, group, "geometry")


def add_reading(
    builder: DiagramBuilder,
    mechanism: Mechanism,
    sight: Sight,
    bodies: dict[int, BodyBlocks],
    group: str,
) -> str:
    """Add what a probe reads of the bodies; return its block, empty where no free body is read."""
    sides = _line_of_sight(mechanism, sight, bodies)
    gains = []
    for number, (end, sign, row) in enumerate(sides):
        gain = _add_row(builder, f"probe {sight.name}", end, row, group, f"motion_{number + 1}")
        builder.connect(end.motion, gain, "q" + end.label)
        gains.append((gain, sign))
    if len(gains) < 2:
        return gains[0][0] if gains else ""
    total = builder.add(
        f"{group}_distance", "sum", "+", f"distance that probe {sight.name} reads [m]", group=group
    )
    for gain, sign in gains:
        builder.term(total, gain, sign)
    return total


def output_scale(model: DynamicModel, drive: ModelDrive) -> float:
    """Return the free displacement over the output of a drive's hysteresis.

    It is 1 but for a hysteresis that was identified from voltage to reading [m/unit].
    """
    if drive.hysteresis is None or drive.stiffness is None:
        return 1.0
    port = model.system.drive(drive.name)
    found = modes(model.system, drives="in place", count=None)
    kept = drive.modal_gain.size
    own = (drive.stiffness or 1.0) * (port.vector @ found.shapes[:, :kept])
    own = own / found.omega[:kept] ** 2
    at = int(np.argmax(np.abs(own)))
    scale = float(drive.modal_gain[at] / own[at])
    return 1.0 if abs(scale - 1.0) < 1e-9 else scale


def add_drive_chain(
    builder: DiagramBuilder, model: DynamicModel, drive: ModelDrive, group: str
) -> str:
    """Add what lies before the spring of a drive; return what gives w [m], or the force [N]."""
    what = "force" if drive.stiffness == 0.0 else "free displacement"
    unit = "N" if drive.stiffness == 0.0 else "m"
    words = f"{what} of drive {drive.name} [{unit}]"
    at = builder.add(
        f"{group}_command",
        "input",
        f"u_{drive.name}",
        f"command of drive {drive.name} [{drive.unit}]",
        group=group,
        role="drive",
        unit=drive.unit,
    )
    signal = f"u_{drive.name} [{drive.unit}]"
    if drive.amplifier is not None:
        block = builder.add(
            f"{group}_amplifier",
            "amplifier",
            "amplifier",
            f"amplifier of drive {drive.name}, {drive.amplifier.bandwidth_hz:.4g} Hz [V]",
            group=group,
            model=drive.amplifier,
            role="drive",
        )
        builder.connect(at, block, signal)
        at, signal = block, f"v_{drive.name} [V]"
    if drive.hysteresis is not None:
        block = builder.add(
            f"{group}_hysteresis",
            "hysteresis",
            "hysteresis",
            f"hysteresis ({drive.hysteresis.kind}) from voltage [V] to {words}",
            group=group,
            model=drive.hysteresis,
            role="drive",
        )
        builder.connect(at, block, signal)
        at, signal = block, ""
        scale = output_scale(model, drive)
        if scale != 1.0:
            meaning = f"{words} over what was identified"
            at = builder.chain(
                at, builder.gain(f"{group}_scale", "c", meaning, scale, group, "drive")
            )
    elif drive.gain != 1.0 or drive.unit != unit:
        meaning = f"{what} over command of drive {drive.name} [{unit}/{drive.unit}]"
        block = builder.gain(f"{group}_gain", "c", meaning, drive.gain, group, "drive")
        builder.connect(at, block, signal)
        at, signal = block, ""
    if drive.creep is not None:
        block = builder.add(
            f"{group}_creep",
            "creep",
            "creep",
            f"creep of the {words}, {100.0 * drive.creep.rate_per_decade:.3g} % a decade",
            group=group,
            model=drive.creep,
            role="drive",
        )
        at = builder.chain(at, block)
    return at


def add_probe_chain(
    builder: DiagramBuilder, probe: ModelProbe, source: str, group: str, signal: str = ""
) -> str:
    """Add what lies behind the true motion [m] at a probe: its sensor, and the output, returned."""
    at = source
    if probe.sensor is not None:
        block = builder.add(
            f"{group}_sensor",
            "sensor",
            "sensor",
            f"sensor of probe {probe.name}, without its noise [{probe.unit}]",
            group=group,
            model=probe.sensor,
        )
        builder.connect(at, block, signal)
        at, signal = block, ""
    out = builder.add(
        f"{group}_reading",
        "output",
        f"y_{probe.name}",
        f"reading of probe {probe.name} [{probe.unit}]",
        group=group,
        unit=probe.unit,
    )
    builder.connect(at, out, signal or f"y_{probe.name} [{probe.unit}]")
    return out
