"""Studies, records, stage moves and certificates of the view Centring."""

import math
import re
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from flexstage.base import progress
from flexstage.base.errors import ControllerError, ModelError, RecordError
from flexstage.centring import ARCSEC
from flexstage.centring.calibrate import calibrate_files
from flexstage.centring.from_records import centre_files
from flexstage.centring.requests import CalibrateRequest, CentreRequest, CertificateRequest
from flexstage.centring.table_file import RotaryTable
from flexstage.files.names import file_name
from flexstage.files.plain import json_text
from flexstage.files.write import write_files
from flexstage.instruments.limits import check_position
from flexstage.quantities.quantity import Quantity
from flexstage.records import Channel, Record, write_record
from flexstage.records.contents import LikelyTurn, contents, likely_turn, read_whole
from flexstage.report.certificate import certificate_page
from flexstage.report.figures.centring import draw_error_budget, draw_polar
from flexstage.studies.requests import ScaleRequest
from flexstage.studies.scale import JudgedStage, ScaleStudy, planar_designs, study_scale
from flexstage.studies.settings import MoveSettings, settings_of
from flexstage.virtual import TableMounting, VirtualTable
from flexstage.web.bench.link import BenchLink
from flexstage.web.live_history import LiveChannel, LiveHistory
from flexstage.web.pictures import inline
from flexstage.web.reports import WrittenReport, new_folder

#: The table of a new page.
EXAMPLE = """\
table: 1
name: comparator
scale:
  kind: disc
  radius: 48 mm
  diameter: 100 mm
  mass: 250 g
  eccentricity: 50 um   # largest, after mounting
  ellipticity: 0.1 um
  tilt: 10 arcsec
heads:
  angles: [0 deg, 92 deg, 178 deg, 275 deg]
  noise: 0.2 arcsec
  gap_change: 50 um
axis:
  radial_synchronous: 0.1 um
  radial_asynchronous: 0.05 um
  axial: 1 um
  speed: 10 rpm
mounting_angle: 30 deg
space: {diameter: 320 mm, height: 12 mm}
tolerance:
  error: 2 arcsec
  reading: each
  eccentricity: 0.3 um
"""
# of a simulated table: direction of its eccentricity [rad], gain of its stage, time of a turn [s]
_DIRECTION, _GAIN, _TURN_TIME = -0.6, 1.03, 1.2
_FRAME = 0.04  # between two readings of a turning table [s]
_FEWEST = 8  # smallest number of readings of a gauge in a turn


@dataclass(frozen=True, slots=True, kw_only=True)
class StudiedTable:
    """A table with what its scale needs."""

    study: ScaleStudy
    """The study, as `flexstage scale` makes it."""
    stages: dict[str, JudgedStage]
    """The judged stages, by names of designs and files."""
    svg: str
    """Its error budget."""


def study_table(table: RotaryTable, own_stages: Sequence[str], key: str) -> StudiedTable:
    """Study a table, with built-in designs and own stage files; ids begin with `key`."""
    names = (*planar_designs(), *own_stages)
    study = study_scale(table, ScaleRequest(stage=names))
    title = f"Error budget of {table.name}, as mounted and centred"
    return StudiedTable(
        study=study,
        stages=dict(zip(names, study.stages, strict=True)),
        svg=inline(lambda: draw_error_budget(study), key, title),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class CentreFiles:
    """Records in sequence, and the request of their evaluation."""

    files: tuple[Path, ...]
    """Record of each turn."""
    request: CentreRequest
    """The request, with the stage positions of three or more trial moves."""
    stage: str | None
    """Stage whose drives are set; None where no move is known yet."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CentringResult:
    """Result of the evaluation of turns."""

    evaluation: CentreFiles
    """Records and request."""
    data: dict[str, Any]
    """Results as `flexstage centre --json` prints them."""
    svg: str
    """Error over the first and the last turn, and its harmonics."""
    settings: MoveSettings | None
    """Settings of the drives for the next move."""
    problem: str
    """Why there are no settings; empty if there are, or if none are wanted."""

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
    data, settings, problem = result.to_dict(), None, ""
    if evaluation.stage is not None:
        try:
            settings = settings_of(result, evaluation.stage)
            data["settings"] = settings.to_dict()
        except ModelError as error:
            problem = str(error)
    return CentringResult(
        evaluation=evaluation, data=data, svg=svg, settings=settings, problem=problem
    )


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
    if not np.isfinite(values).all():
        raise RecordError("the readings must be finite numbers")
    if values.size < _FEWEST:
        raise RecordError(
            f"a turn needs at least {_FEWEST} readings at equal angles, got {values.size}"
        )
    index = np.arange(values.size, dtype=np.float64)
    channels = (
        Channel(name="angle", values=2.0 * math.pi * index / values.size, unit="rad"),
        Channel(name="gauge", values=factor * values, unit="m"),
    )
    write_record(Record(channels=channels, time=index, over="point"), path)


#: Channel of the angle in a live chart of a turning table.
ANGLE = "angle"
_ANGLE = Quantity("angle", "rad", "Angle of the table", "deg", math.degrees(1.0))
_ERROR = Quantity("error", "rad", "Reading error", "arcsec", 1.0 / ARCSEC)


def turn_history(table: RotaryTable) -> LiveHistory:
    """Return an empty history for one record of a simulated table."""
    heads = [LiveChannel(f"head {j + 1}", _ERROR) for j in range(len(table.heads.angles))]
    bench = VirtualTable.described(table)
    # the live chart has room for a record, and shows every sample
    return LiveHistory(
        [LiveChannel(ANGLE, _ANGLE), *heads],
        rate_hz=bench.samples / _TURN_TIME,
        hours=1.2 * bench.turns * _TURN_TIME / 3600.0,
    )


def turn_table(
    table: RotaryTable, displacement: Sequence[float], index: int, path: Path, history: LiveHistory
) -> Path:
    """Turn a simulated table after a displacement of its stage, x and y [m], and write the record.

    The readings enter the history as the table turns; `index` is the number of the record.
    """
    frame = _GAIN * TableMounting(angle=table.mounting_angle).matrix
    x, y = frame @ np.asarray(displacement)
    bench = VirtualTable.described(table, direction=_DIRECTION, seed=1).moved(float(x), float(y))
    record = bench.record(index=index)
    values = np.column_stack([channel.values for channel in record.channels])
    times = np.arange(record.size) * (_TURN_TIME / bench.samples)
    begin, read = time.monotonic(), 0
    while read < record.size:
        progress.update("turning", read / record.size)
        now = int(np.searchsorted(times, time.monotonic() - begin, side="right"))
        history.append(times[read:now], values[read:now])
        read = now
        time.sleep(_FRAME)
    write_record(record, path)
    return path


def certify(
    folder: Path,
    table: str,
    record: Path,
    request: CalibrateRequest,
    stated: CertificateRequest,
    notes: Sequence[str] = (),
) -> WrittenReport:
    """Calibrate a scale as `flexstage calibrate --certificate` does, and write the certificate."""
    calibration = calibrate_files([record], request)
    calibration = replace(calibration, notes=(*notes, *calibration.notes))
    page = certificate_page(calibration, stated, [record])
    written = new_folder(folder, file_name(f"certificate-{table}"))
    result = json_text(calibration.to_dict())
    write_files(written, {"report.html": page.encode(), "results.json": result.encode()})
    return WrittenReport(written)


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
