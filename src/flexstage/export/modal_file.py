"""Modes and frequency responses of a stage as universal files, for modal test programs.

They are given at points of the stage, which lines join.
"""

import csv
import io
import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

import flexstage
from flexstage.arrays import Array
from flexstage.errors import ModelError
from flexstage.export.request import StageExport
from flexstage.export.universal_format import (
    DISPLACEMENT,
    FORCE,
    frequency_function,
    heading,
    mode_shape,
    point_list,
    si_units,
    trace_lines,
)
from flexstage.files.names import file_name
from flexstage.stage import Circle, Stage
from flexstage.stage.contour import body_contour
from flexstage.stage.mass import mass_properties
from flexstage.system import (
    DriveCondition,
    FrequencyResponse,
    MechanicalSystem,
    Modes,
    frequency_response,
    modes,
)
from flexstage.system.response import default_frequencies_hz

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


def universal_files(
    stage: Stage,
    system: MechanicalSystem,
    *,
    drives: DriveCondition = "removed",
    count: int = 12,
    frequency_hz: ArrayLike | None = None,
) -> dict[str, bytes]:
    """Return modes and frequency responses of a stage as universal files.

    ``NAME-modes.uff``: points, outlines and modes (see `modal_file`). ``NAME-frf.uff``: the
    response of each probe of the stage to each drive (see `frf_file`), none with drives ``locked``.
    ``NAME-points.csv``: what each point is.

    Frequencies [Hz] lie about the lowest modes where not given. They are rounded to the six digits
    that the format has for them before the responses are found, so that each value belongs to its
    frequency as it is written.

    Examples
    --------
    >>> from flexstage.designs import design
    >>> from flexstage.lumped import lumped_system
    >>> stage = design("parallelogram")
    >>> files = universal_files(stage, lumped_system(stage), count=3)
    >>> sorted(files)
    ['parallelogram-frf.uff', 'parallelogram-modes.uff', 'parallelogram-points.csv']
    """
    if count < 1:
        raise ModelError(f"the number of modes must be 1 or more, got {count!r}")
    name, points = file_name(stage.name), modal_points(stage)
    found = modes(system, drives=drives, count=count)
    files = {f"{name}-modes.uff": modal_file(stage, system, found)}
    if drives != "locked" and stage.drives and stage.probes:
        wanted = default_frequencies_hz(found) if frequency_hz is None else frequency_hz
        written = np.array([float(f"{f:.5e}") for f in np.atleast_1d(wanted).tolist()])
        written = np.unique(written)
        responses = [
            frequency_response(system, written, d.name, p.name, drives=drives)
            for d in stage.drives
            for p in stage.probes
        ]
        files[f"{name}-frf.uff"] = frf_file(stage, responses)
    files[f"{name}-points.csv"] = points.table()
    return files


def modal_file(stage: Stage, system: MechanicalSystem, found: Modes) -> bytes:
    """Return modes of a stage as a universal file.

    Data sets: heading (151), units (164, metre and newton), points (2411), outlines of the bodies
    with their half notches (82), and each mode (55) with its frequency, viscous damping ratio and
    unit modal mass, in six directions at each point.

    Notes
    -----
    Validity: points move with their bodies as rigid ones. Out of the plane there is the motion of
    bodies that a probe reads, at the probe, in models that have it (solid), without tilt; other
    bodies have 0 there. The format has six digits for shapes and frequencies, and 17 for points.
    """
    points = modal_points(stage)
    parts = [_opening(stage, f"modes by the {system.model} model"), _geometry(points)]
    numbers = range(1, len(points.body) + 1)
    for k, (frequency, ratio) in enumerate(
        zip(found.frequency_hz.tolist(), found.damping_ratio.tolist(), strict=True), start=1
    ):
        titles = (
            f"{stage.name}: mode {k} at {frequency:.6g} Hz",
            f"{system.model} model, drives {found.drives}",
            "NONE",
            "unit modal mass; displacement in m, rotation in rad, for 1 kg^0.5 m",
            f"flexstage {flexstage.__version__}",
        )
        shape = points.shape(system, found.shapes[:, k - 1])
        parts.append(mode_shape(titles, k, frequency, ratio, numbers, shape))
    return "".join(parts).encode("ascii")


def frf_file(stage: Stage, responses: Iterable[FrequencyResponse]) -> bytes:
    """Return frequency responses of a stage as a universal file.

    Data sets: heading (151), units (164), points (2411), outlines (82), and each response (58),
    complex in double precision: displacement of the probe's point, or rotation of its body, over
    the force of the drive on the point that it pushes, or over its free displacement.

    Notes
    -----
    Validity: a drive pushes one body and reacts on another, and a probe may read one against
    another; the format names one point of each, and the titles say the rest. Directions other than
    along x and y have the number 0, and a rotation has 6. The format has 13 digits for values, and
    six for frequencies that are not evenly spaced: give frequencies of six digits, as
    `universal_files` does, else values near a resonance seem to be up to 1e-6 times its quality
    off.
    """
    points = modal_points(stage)
    parts = [_opening(stage, "frequency responses"), _geometry(points)]
    functions = [
        _function(stage, points, number, response)
        for number, response in enumerate(responses, start=1)
    ]
    return "".join((*parts, *functions)).encode("ascii")


def _opening(stage: Stage, what: str) -> str:
    program = f"flexstage {flexstage.__version__}"
    return heading(stage.name, f"{what}: {stage.title or stage.name}", program) + (si_units())


def _geometry(points: ModalPoints) -> str:
    written = [point_list(range(1, len(points.body) + 1), points.position)]
    number = 1
    for name, line in points.lines:
        written.append(trace_lines(number, name, line))
        number += max(1, math.ceil((len(line) - 1) / 249))
    return "".join(written)


def _function(stage: Stage, points: ModalPoints, number: int, response: FrequencyResponse) -> str:
    probe, drive = stage.probe(response.probe), stage.drive(response.drive)
    if response.frequency_hz.size < 2:
        raise ModelError(
            f"the response of '{probe.name}' to '{drive.name}' must have two frequencies or more, "
            f"got {response.frequency_hz.size}"
        )
    along = probe.direction
    against = "the ground" if probe.relative_to is None else f"body {probe.relative_to}"
    titles = (
        f"{stage.name}: probe {probe.name} over drive {drive.name}",
        f"{probe.reads} over {response.input_kind}, drives {response.drives}",
        "NONE",
        f"probe on {probe.body} against {against}, "
        + ("about z" if along is None else f"at {_degrees(along)} deg"),
        f"drive pushes {drive.pushes}, reacts on {drive.reacts}, at {_degrees(drive.direction)} "
        "deg",
    )
    return frequency_function(
        titles,
        number,
        (probe.name, points.numbers["probe", probe.name], direction_code(along)),
        probe.unit,
        (drive.name, points.numbers["drive", drive.name], direction_code(drive.direction)),
        FORCE if response.unit.endswith("/N") else DISPLACEMENT,
        response.frequency_hz,
        response.value,
    )


def _degrees(angle: float) -> str:
    return f"{math.degrees(angle):.6g}"


def direction_code(angle: float | None) -> int:
    """Return the number that universal files have for a direction in the plane [rad].

    1 along x, 2 along y, negative the other way; 0 for any other; 6 about z, without an angle.

    Examples
    --------
    >>> import math
    >>> direction_code(0.0), direction_code(-math.pi / 2), direction_code(1.0)
    (1, -2, 0)
    """
    if angle is None:
        return 6
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


def export(given: StageExport) -> dict[str, bytes]:
    """Write the format."""
    return universal_files(given.stage, given.analysis.system)
