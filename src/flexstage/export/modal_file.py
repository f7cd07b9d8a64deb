"""Modes and frequency responses of a stage as universal files, for modal test programs.

They belong to points of the stage, which are joined by trace lines.
"""

import math
import re
import unicodedata
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexstage.base.arrays import Array
from flexstage.base.errors import ModelError
from flexstage.base.version import __version__
from flexstage.export.request import StageExport
from flexstage.files.names import file_name
from flexstage.files.plain import csv_text
from flexstage.stage import Circle, Stage
from flexstage.stage.contour import body_contour
from flexstage.stage.mass import mass_properties
from flexstage.system import (
    FrequencyResponse,
    MechanicalSystem,
    Modes,
    frequency_response,
    modes,
)
from flexstage.system.response import default_frequencies_hz

#: Codes of quantities.
DISPLACEMENT, FORCE = 8, 13
_FREQUENCY = 18
_FRF = 4  # frequency response function
_NAMES = {DISPLACEMENT: ("displacement", "m"), FORCE: ("force", "N")}
# constant, so that the same stage gives the same bytes
_TIME = "01-JAN-70 00:00:00"
_LONGEST = 250  # points of a trace line


def _set(number: int, lines: Sequence[str]) -> str:
    return "\n".join(("    -1", f"{number:6d}", *lines, "    -1", ""))


def _text(words: str) -> str:
    """Return a line of text: 80 ASCII characters, never the end mark of a data set."""
    ascii_text = unicodedata.normalize("NFKD", words.replace("µ", "u"))
    plain = "".join(c if c.isascii() and c.isprintable() else "" for c in ascii_text).strip()
    return (re.sub(r"^-1\b", "- 1", plain) or "NONE")[:80]


def _reals(values: Sequence[float], in_line: int) -> list[str]:
    """Return numbers in columns."""
    words = [f"{v:13.5E}" for v in values]
    return ["".join(words[i : i + in_line]) for i in range(0, len(words), in_line)]


def heading(name: str, description: str, program: str) -> str:
    """Return data set 151, the header of the file."""
    lines = (
        _text(name),
        _text(description),
        _text(program),
        f"{_TIME}  {0:10d}{0:10d}{0:10d}",
        _TIME,
        _text(program),
        _TIME,
    )
    return _set(151, [line.rstrip() for line in lines])


def si_units() -> str:
    """Return data set 164: metre and newton."""
    one = f"{1.0:25.17E}".replace("E", "D")
    none = f"{273.15:25.17E}".replace("E", "D")
    return _set(164, (f"{1:10d}{'SI: metre, newton':<20}{2:10d}", 3 * one, none))


def point_list(numbers: Sequence[int], positions: Array) -> str:
    """Return data set 2411: points [m] in double precision."""
    lines = []
    for number, position in zip(numbers, positions.tolist(), strict=True):
        lines.append(f"{number:10d}{1:10d}{1:10d}{11:10d}")
        lines.append("".join(f"{x:25.16E}" for x in position).replace("E", "D"))
    return _set(2411, lines)


def trace_lines(first: int, name: str, points: Sequence[int]) -> str:
    """Return data sets 82: a trace line in parts of at most 250 points, numbered from `first`."""
    parts = []
    # each part begins at the end of the previous one
    for k, start in enumerate(range(0, max(len(points) - 1, 1), _LONGEST - 1)):
        part = points[start : start + _LONGEST]
        lines = [f"{first + k:10d}{len(part):10d}{7:10d}", _text(name)]
        for i in range(0, len(part), 8):
            lines.append("".join(f"{number:10d}" for number in part[i : i + 8]))
        parts.append(_set(82, lines))
    return "".join(parts)


def mode_shape(
    titles: Sequence[str],
    number: int,
    frequency_hz: float,
    damping_ratio: float,
    points: Sequence[int],
    shape: Array,
) -> str:
    """Return data set 55: a normal mode of unit modal mass at points, in six directions.

    Its shape is displacement along x, y, z [m] and rotation about them [rad] for a modal coordinate
    of 1 kg^0.5 m, shape (n, 6); titles are at most five lines.
    """
    lines = [_text(title) for title in (*titles, "", "", "", "", "")[:5]]
    # structural, normal mode, six directions, displacement, real numbers, six of them
    lines.append("".join(f"{code:10d}" for code in (1, 2, 3, DISPLACEMENT, 2, 6)))
    lines.append("".join(f"{code:10d}" for code in (2, 4, 0, number)))
    lines += _reals((frequency_hz, 1.0, damping_ratio, 0.0), 6)
    for point, row in zip(points, shape.tolist(), strict=True):
        lines.append(f"{point:10d}")
        lines += _reals(row, 6)
    return _set(55, lines)


def frequency_function(
    titles: Sequence[str],
    number: int,
    response: tuple[str, int, int],
    unit: str,
    reference: tuple[str, int, int],
    denominator: int,
    frequency_hz: Array,
    value: NDArray[np.complex128],
) -> str:
    """Return data set 58: a complex frequency response function in double precision.

    Response and reference are name, number of the point and direction: 1 to 3 along x, y, z, 4 to 6
    about them, negative for the opposite direction, 0 for any other. The unit of the response is m
    or rad. The denominator is the quantity of the reference, `FORCE` or `DISPLACEMENT`. Frequencies
    have six digits.
    """
    lines = [_text(title) for title in (*titles, "", "", "", "", "")[:5]]
    places = "".join(
        f" {_text(name)[:10]:<10}{point:10d}{direction:4d}"
        for name, point, direction in (response, reference)
    )
    lines.append(f"{_FRF:5d}{number:10d}{0:5d}{0:10d}{places}")
    # complex in double precision, each with its frequency
    stored = "".join(f"{code:10d}" for code in (6, frequency_hz.size, 0))
    lines.append(stored + "".join(_reals((0.0, 0.0, 0.0), 3)))
    lines.append(f"{_FREQUENCY:10d}{0:5d}{0:5d}{0:5d} {'frequency':<20} {'Hz':<20}")
    above = (DISPLACEMENT, "rotation" if unit == "rad" else "displacement", unit)
    for kind, label, of in (above, (denominator, *_NAMES[denominator])):
        lines.append(f"{kind:10d}{0:5d}{0:5d}{0:5d} {label:<20} {of:<20}")
    lines.append(f"{0:10d}{0:5d}{0:5d}{0:5d} {'NONE':<20} {'NONE':<20}")
    pairs = np.column_stack((value.real, value.imag))
    for f, (real, imaginary) in zip(frequency_hz.tolist(), pairs.tolist(), strict=True):
        lines.append(f"{f:13.5E}{real:20.12E}{imaginary:20.12E}")
    return _set(58, lines)


_OUTLINE = 5e-5  # distance of a chord from its arc [m]
_ALONG = 1e-9  # tolerance of the direction of an axis [rad]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ModalPoints:
    """Points of a stage, numbered from 1."""

    position: Array
    """Positions [m], shape (n, 3)."""
    body: tuple[str, ...]
    """Body of each point."""
    what: tuple[str, ...]
    """Description of each point, which may be several things."""
    lines: tuple[tuple[str, tuple[int, ...]], ...]
    """Name and point numbers of each closed line."""
    numbers: dict[tuple[str, str], int]
    """Number of a point by kind (``probe``, ``drive``, ``reaction`` or ``centre``) and name."""

    def shape(self, system: MechanicalSystem, q: Array) -> Array:
        """Return the motion of the points with their rigid bodies, shape (n, 6).

        It is displacement along x, y, z [m] and rotation about them [rad]. Displacement out of the
        plane is that of a probe on the body, if there is one; tilt is 0. Bodies that are not in the
        system do not move.
        """
        motion = np.zeros((len(self.body), 6))
        lifts = {p.name: float(p.vector @ q) for p in system.probes}
        owner = np.array(self.body)
        for port in system.bodies:
            on_body = owner == port.name
            x, y, turn = port.matrix @ q
            motion[on_body, 0] = x - turn * (self.position[on_body, 1] - port.centre[1])
            motion[on_body, 1] = y + turn * (self.position[on_body, 0] - port.centre[0])
            motion[on_body, 2] = lifts.get(f"{port.name} out of plane", 0.0)
            motion[on_body, 5] = turn
        return motion

    def table(self) -> bytes:
        """Return the points as CSV: number, body, description, position [m]."""
        heading = ("point", "body", "what", "x [m]", "y [m]", "z [m]")
        places = zip(self.body, self.what, self.position.tolist(), strict=True)
        rows = ((k, body, what, *at) for k, (body, what, at) in enumerate(places, 1))
        return csv_text([heading, *rows], "\r\n").encode()


def universal_files(
    stage: Stage,
    system: MechanicalSystem,
    *,
    count: int = 12,
) -> dict[str, bytes]:
    """Return modes and frequency responses of a stage, drives removed, as universal files.

    ``NAME-modes.uff``: points, outlines and modes (see `modal_file`). ``NAME-frf.uff``: the
    response of each probe to each drive (see `frf_file`).
    ``NAME-points.csv``: description of each point.

    Frequencies are around the lowest modes. They are rounded to six digits, as in the format,
    before the responses are computed, so that each value belongs to its written frequency.

    Examples
    --------
    >>> from flexstage.stage.designs import design
    >>> from flexstage.lumped import lumped_system
    >>> stage = design("parallelogram")
    >>> files = universal_files(stage, lumped_system(stage), count=3)
    >>> sorted(files)
    ['parallelogram-frf.uff', 'parallelogram-modes.uff', 'parallelogram-points.csv']
    """
    if count < 1:
        raise ModelError(f"the number of modes must be 1 or more, got {count!r}")
    name, points = file_name(stage.name), modal_points(stage)
    shapes = modes(system, drives="removed", count=count)
    files = {f"{name}-modes.uff": modal_file(stage, system, shapes)}
    if stage.drives and stage.probes:
        frequencies = np.unique([float(f"{f:.5e}") for f in default_frequencies_hz(shapes)])
        responses = [
            frequency_response(system, frequencies, d.name, p.name)
            for d in stage.drives
            for p in stage.probes
        ]
        files[f"{name}-frf.uff"] = frf_file(stage, responses)
    files[f"{name}-points.csv"] = points.table()
    return files


def modal_file(stage: Stage, system: MechanicalSystem, shapes: Modes) -> bytes:
    """Return modes of a stage as a universal file.

    Data sets: heading (151), units (164, metre and newton), points (2411), outlines of the bodies
    with their half notches (82), and each mode (55) with its frequency, viscous damping ratio and
    unit modal mass, in six directions at each point.

    Notes
    -----
    Validity: points move with their rigid bodies. Motion out of the plane is that of a probe on the
    body, in models that have it (solid), without tilt; for other bodies it is 0. The format has six
    digits for shapes and frequencies, and 17 for points.
    """
    points = modal_points(stage)
    parts = [_opening(stage, f"modes by the {system.model} model"), _geometry(points)]
    numbers = range(1, len(points.body) + 1)
    for k, (frequency, ratio) in enumerate(
        zip(shapes.frequency_hz.tolist(), shapes.damping_ratio.tolist(), strict=True), start=1
    ):
        titles = (
            f"{stage.name}: mode {k} at {frequency:.6g} Hz",
            f"{system.model} model, drives {shapes.drives}",
            "NONE",
            "unit modal mass; displacement in m, rotation in rad, for 1 kg^0.5 m",
            f"flexstage {__version__}",
        )
        shape = points.shape(system, shapes.shapes[:, k - 1])
        parts.append(mode_shape(titles, k, frequency, ratio, numbers, shape))
    return "".join(parts).encode("ascii")


def frf_file(stage: Stage, responses: Iterable[FrequencyResponse]) -> bytes:
    """Return frequency responses of a stage as a universal file.

    Data sets: heading (151), units (164), points (2411), outlines (82), and each response (58),
    complex in double precision: displacement at the probe, or rotation of its body, over the force
    of the drive or over its free displacement.

    Notes
    -----
    Validity: a drive pushes one body and reacts on another, and a probe may be relative; the format
    has one point of each, and the titles name both bodies. Directions other than along x and y have
    code 0, a rotation has 6. The format has 13 digits for values, and six for frequencies: use
    frequencies of six digits, as `universal_files` does; otherwise values near a resonance have an
    apparent relative error of up to 1e-6 times its quality factor.
    """
    points = modal_points(stage)
    parts = [_opening(stage, "frequency responses"), _geometry(points)]
    functions = [
        _function(stage, points, number, response)
        for number, response in enumerate(responses, start=1)
    ]
    return "".join((*parts, *functions)).encode("ascii")


def _opening(stage: Stage, what: str) -> str:
    program = f"flexstage {__version__}"
    return heading(stage.name, f"{what}: {stage.title or stage.name}", program) + (si_units())


def _geometry(points: ModalPoints) -> str:
    parts = [point_list(range(1, len(points.body) + 1), points.position)]
    number = 1
    for name, line in points.lines:
        parts.append(trace_lines(number, name, line))
        number += max(1, math.ceil((len(line) - 1) / 249))
    return "".join(parts)


def _function(stage: Stage, points: ModalPoints, number: int, response: FrequencyResponse) -> str:
    probe, drive = stage.probe(response.probe), stage.drive(response.drive)
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
    """Return the code of a direction in the plane [rad] in universal files.

    It is 1 along x, 2 along y, negative for opposite directions, 0 for any other, and 6 for a
    rotation about z, which has no angle.

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

    A point of one body with several roles has one number.
    """
    position: list[tuple[float, float]] = []
    body: list[str] = []
    what: list[str] = []
    numbered: dict[tuple[str, float, float], int] = {}
    numbers: dict[tuple[str, str], int] = {}

    def add(owner: str, at: Iterable[float], words: str) -> int:
        x, y = at
        # to a picometre
        key = (owner, round(x, 12), round(y, 12))
        if key not in numbered:
            position.append((x, y))
            body.append(owner)
            what.append(words)
            numbered[key] = len(position)
        elif words not in (words_before := what[numbered[key] - 1].split("; ")):
            what[numbered[key] - 1] = "; ".join((*words_before, words))
        return numbered[key]

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


def export(stage_export: StageExport) -> dict[str, bytes]:
    """Return the files of the format."""
    return universal_files(stage_export.stage, stage_export.analysis.system)
