"""Points of a stage at which modes are given and lines that join them, for modal programs."""

import csv
import io
import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from flexstage.arrays import Array
from flexstage.stage import Circle, Stage
from flexstage.stage.contour import body_contour
from flexstage.stage.mass import mass_properties
from flexstage.system import MechanicalSystem

_OUTLINE = 5e-5  # a chord lies within this of its arc [m]
_ALONG = 1e-9  # a direction is that of an axis [rad]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ModalPoints:
    """Points of a stage, numbered from 1."""

    position: Array
    """The points [m], shape (n, 3)."""
    body: tuple[str, ...]
    """Body that each moves with."""
    what: tuple[str, ...]
    """What each is; one that is several things has them all."""
    lines: tuple[tuple[str, tuple[int, ...]], ...]
    """Name and numbers of the points of each closed line."""
    numbers: dict[tuple[str, str], int]
    """Number of a point by kind (``probe``, ``drive``, ``reaction`` or ``centre``) and name."""

    def shape(self, system: MechanicalSystem, q: Array) -> Array:
        """Return how the points move, each with its body as a rigid one, shape (n, 6).

        Displacement along x, y, z [m] and rotation about them [rad]. Out of the plane there is what
        the system reads of a body, where it does, and no tilt. Bodies that the system does not name
        stand still.
        """
        found = np.zeros((len(self.body), 6))
        lifts = {p.name: float(p.vector @ q) for p in system.probes}
        owner = np.array(self.body)
        for port in system.bodies:
            own = owner == port.name
            x, y, turn = port.matrix @ q
            found[own, 0] = x - turn * (self.position[own, 1] - port.centre[1])
            found[own, 1] = y + turn * (self.position[own, 0] - port.centre[0])
            found[own, 2] = lifts.get(f"{port.name} out of plane", 0.0)
            found[own, 5] = turn
        return found

    def table(self) -> bytes:
        """Return the points as CSV: number, body, what it is, position [m]."""
        text = io.StringIO()
        rows = csv.writer(text, lineterminator="\r\n")
        rows.writerow(("point", "body", "what", "x [m]", "y [m]", "z [m]"))
        places = self.position.tolist()
        for k, (body, what, at) in enumerate(zip(self.body, self.what, places, strict=True), 1):
            rows.writerow((k, body, what, *at))
        return text.getvalue().encode()


def direction_code(angle: float) -> int:
    """Return the number that universal files have for a direction in the plane [rad].

    1 along x, 2 along y, negative the other way; 0 for any other.

    Examples
    --------
    >>> import math
    >>> direction_code(0.0), direction_code(-math.pi / 2), direction_code(1.0)
    (1, -2, 0)
    """
    c, s = math.cos(angle), math.sin(angle)
    if abs(s) < _ALONG:
        return 1 if c > 0.0 else -1
    if abs(c) < _ALONG:
        return 2 if s > 0.0 else -2
    return 0


def modal_points(stage: Stage) -> ModalPoints:
    """Return the points of a stage: probes, drives, centres of mass, outlines with notches.

    A point of one body that is several of these has one number.
    """
    position: list[tuple[float, float]] = []
    body: list[str] = []
    what: list[str] = []
    known: dict[tuple[str, float, float], int] = {}
    numbers: dict[tuple[str, str], int] = {}

    def add(owner: str, at: Iterable[float], words: str) -> int:
        x, y = at
        # to a picometre
        key = (owner, round(x, 12), round(y, 12))
        if key not in known:
            position.append((x, y))
            body.append(owner)
            what.append(words)
            known[key] = len(position)
        elif words not in (had := what[known[key] - 1].split("; ")):
            what[known[key] - 1] = "; ".join((*had, words))
        return known[key]

    for p in stage.probes:
        numbers["probe", p.name] = add(p.body, p.at, f"probe {p.name}")
    for d in stage.drives:
        numbers["drive", d.name] = add(d.pushes, d.at[0], f"drive {d.name}")
        numbers["reaction", d.name] = add(d.reacts, d.at[1], f"reaction of drive {d.name}")
    for name, of_body in mass_properties(stage).items():
        numbers["centre", name] = add(name, of_body.centre, "centre of mass")
    lines = []
    for b in stage.bodies:
        outline, holes = body_contour(stage, b)
        for k, loop in enumerate((outline, *holes, *b.mounting_holes)):
            closed = loop.loop() if isinstance(loop, Circle) else loop
            word = "outline" if k == 0 else f"hole {k}"
            points = [add(b.name, at, word) for at in closed.polyline(_OUTLINE).tolist()]
            lines.append((f"{b.name} {word}", (*points, points[0])))
    return ModalPoints(
        position=np.column_stack((np.array(position), np.zeros(len(position)))),
        body=tuple(body),
        what=tuple(what),
        lines=tuple(lines),
        numbers=numbers,
    )
