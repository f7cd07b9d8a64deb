"""Evaluation, records and stage moves of the view Centring."""

import math
import re
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from flexstage.base.arrays import Array
from flexstage.base.errors import ControllerError, ModelError, RecordError
from flexstage.centring import ARCSEC
from flexstage.centring.from_records import centre_files
from flexstage.centring.requests import CentreRequest
from flexstage.instruments.limits import check_position
from flexstage.records import Channel, Record, write_record
from flexstage.records.contents import LikelyTurn, contents, likely_turn, read_whole
from flexstage.report.figures.centring import draw_polar
from flexstage.virtual import VirtualTable, scale_errors
from flexstage.web.bench.link import BenchLink
from flexstage.web.pictures import inline

#: The simulated scale: radius [m], heads [rad], and centre, x and y [m].
EXAMPLE_RADIUS = 50e-3
EXAMPLE_HEADS = (0.0, math.pi)
_CENTRE = (17.3e-6, -11.2e-6)
_ORIENTATION, _GAINS = (
    0.7,
    (1.03, 0.96),
)  # orientation of its stage on the table [rad], and gains of the axes
_FEWEST = 8  # smallest number of readings of a gauge in a turn


@dataclass(frozen=True, slots=True, kw_only=True)
class CentreFiles:
    """Records in sequence, and the request of their evaluation."""

    files: tuple[Path, ...]
    """Record of each turn."""
    request: CentreRequest
    """The request, with the stage positions of three or more turns."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CentringResult:
    """Result of the evaluation of turns."""

    evaluation: CentreFiles
    """Records and request."""
    data: dict[str, Any]
    """Results as `flexstage centre --json` prints them."""
    svg: str
    """Error over the first and the last turn, and its harmonics."""

    @property
    def setups(self) -> list[dict[str, Any]]:
        """Results of each turn."""
        return self.data.get("setups", [self.data])


def evaluate_files(evaluation: CentreFiles, key: str) -> CentringResult:
    """Evaluate records as `flexstage centre` does; ids in the picture begin with `key`."""
    result = centre_files(evaluation.files, evaluation.request)
    numbers = sorted({1, len(result.setups)})
    ends = [result.setups[number - 1] for number in numbers]
    svg = inline(
        lambda: draw_polar(
            [setting.fits[0] for setting in ends],
            [setting.heads[0].angle for setting in ends],
            [f"in turn {number}" for number in numbers],
        ),
        key,
        "Error of the scale over the turn, polar, with the fitted curve, and its harmonics",
    )
    return CentringResult(evaluation=evaluation, data=result.to_dict(), svg=svg)


def likely_columns(path: Path) -> LikelyTurn:
    """Return the likely columns of a file."""
    return likely_turn(contents(*read_whole(path)))


def gauge_record(text: str, factor: float, path: Path) -> None:
    """Write the readings of a gauge at equal angles of one turn as a record.

    `factor` is the unit of the readings in metres.
    """
    parts = re.split(r"[\s;]+", text.replace("\N{MINUS SIGN}", "-").strip())
    try:
        values = np.array([float(part.replace(",", ".")) for part in parts if part])
    except ValueError:
        raise RecordError(
            f"the readings must be numbers separated by spaces, such as 12 8 -3, got '{text[:40]}'"
        ) from None
    if values.size < _FEWEST or not np.isfinite(values).all():
        raise RecordError(
            f"a turn needs at least {_FEWEST} readings at equal angles, got {values.size}"
        )
    angle = 2.0 * math.pi * np.arange(values.size) / values.size
    _write(path, angle, {"gauge": (factor * values, "m")})


def simulated_record(displacement: Sequence[float], index: int, path: Path) -> None:
    """Write a simulated record of the heads after a displacement of the stage, x and y [m]."""
    c, s = math.cos(_ORIENTATION), math.sin(_ORIENTATION)
    # rotated and mirrored, as a real mounting can be
    matrix = np.array([[c, s], [s, -c]]) @ np.diag(_GAINS)
    x, y = np.array(_CENTRE) + matrix @ np.asarray(displacement)
    table = VirtualTable(
        radius=EXAMPLE_RADIUS,
        heads=EXAMPLE_HEADS,
        eccentricity=(float(x), float(y)),
        noise=ARCSEC,
        scale=scale_errors(range(2, 20), 2.0 * ARCSEC, seed=3),
        turns=2,
        seed=3,
    )
    write_record(table.record(index=index), path)


def _write(path: Path, angle: Array, columns: dict[str, tuple[Array, str]]) -> None:
    channels = [Channel(name="angle", values=angle, unit="rad")]
    channels += [Channel(name=n, values=v, unit=unit) for n, (v, unit) in columns.items()]
    index = np.arange(angle.size, dtype=np.float64)
    write_record(Record(channels=tuple(channels), time=index, over="point"), path)


_PATIENCE = 30.0  # s


def axes_of(bench: BenchLink) -> tuple[str, str] | None:
    """Return the two axes that carry the scale; None without a connected two-axis stage."""
    names = tuple(bench.device.axes) if bench.device is not None else ()
    return (names[0], names[1]) if len(names) >= 2 else None


def stage_position(bench: BenchLink) -> tuple[float, float] | None:
    """Return the position of a connected stage [m], or None."""
    axes = axes_of(bench)
    if axes is None or not all(axis in bench.readings for axis in axes):
        return None
    x, y = (bench.readings[axis].position for axis in axes)
    return x, y


def limits_of(bench: BenchLink) -> tuple[tuple[float, float], tuple[float, float]] | None:
    """Return the travel of the axes of a connected stage [m], or None."""
    axes, device = axes_of(bench), bench.device
    if axes is None or device is None:
        return None
    x, y = (device.axes[axis].limits.position for axis in axes)
    return None if x is None or y is None else (x, y)


def noise_of(bench: BenchLink) -> tuple[float, float]:
    """Return three standard deviations of the sensor noise of a connected stage [m]."""
    axes, history = axes_of(bench), bench.history
    span = history.span if history is not None else None
    if axes is None or history is None or span is None:
        return 0.0, 0.0
    window = history.samples(span[1] - 0.5, span[1])  # duration for the noise [s]
    names = [channel.name for channel in history.channels]
    x, y = (3.0 * float(np.std(window.low[:, names.index(f"{axis} position")])) for axis in axes)
    return x, y


def move_to(bench: BenchLink, session: str, target: tuple[float, float]) -> tuple[float, float]:
    """Move both axes to a position [m], and wait for rest; return the final position.

    Raises
    ------
    FlexstageError
        This browser has no control, a limit is exceeded, or position control is off.
    """
    axes = axes_of(bench)
    if axes is None:
        raise ModelError("no two-axis stage is connected: connect one in the view Bench")
    bench.control.require(session)
    open_loop = [name for name in axes if not bench.readings[name].closed_loop]
    if open_loop:
        raise ModelError(
            f"position control of axis {' and '.join(open_loop)} is off: switch it on in the view "
            "Bench"
        )
    # check both before either moves
    for name, value in zip(axes, target, strict=True):
        check_position(bench.linked().axes[name].limits, value, name)
    for name, value, noise in zip(axes, target, noise_of(bench), strict=True):
        if abs(value - bench.readings[name].position) > noise:
            bench.go(session, name, value).result()
    end = time.monotonic() + _PATIENCE
    while any(bench.readings[name].moving for name in axes):
        if time.monotonic() > end:
            raise ControllerError(f"the stage did not come to rest within {_PATIENCE:g} s")
        time.sleep(0.05)
    time.sleep(0.15)  # for a reading at rest
    bench.linked()
    x, y = (bench.readings[name].position for name in axes)
    return x, y
