"""What the view Centring computes, as `flexstage centre` does it, and the records it makes."""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from flexstage.base.arrays import Array
from flexstage.base.errors import RecordError
from flexstage.centring import ARCSEC
from flexstage.centring.from_records import centre_files
from flexstage.centring.requests import CentreRequest
from flexstage.records import Channel, Record, write_record
from flexstage.records.contents import LikelyTurn, contents, likely_turn, read_whole
from flexstage.report.figures.centring import draw_polar
from flexstage.virtual import VirtualTable, scale_errors
from flexstage.web.pictures import inline

#: The scale of the example: radius [m], heads [rad], and where its centre is, x and y [m].
EXAMPLE_RADIUS = 50e-3
EXAMPLE_HEADS = (0.0, math.pi)
_CENTRE = (17.3e-6, -11.2e-6)
_TURNED, _GAINS = 0.7, (1.03, 0.96)  # how its stage lies on the table [rad], and how far it goes
_FEWEST = 8  # readings of a gauge in a turn


@dataclass(frozen=True, slots=True, kw_only=True)
class CentreFiles:
    """What is evaluated: records in sequence, and how they are read."""

    files: tuple[Path, ...]
    """A record of each setting."""
    request: CentreRequest
    """What they hold; with the places of the stage where there are three or more."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CentreFound:
    """What was found."""

    of: CentreFiles
    """Of what."""
    result: dict[str, Any]
    """As `flexstage centre --json` prints it."""
    svg: str
    """Error over the turn of the first setting and the last, and its harmonics."""

    @property
    def setups(self) -> list[dict[str, Any]]:
        """What is said of each setting."""
        return self.result.get("setups", [self.result])


def evaluated(given: CentreFiles, key: str) -> CentreFound:
    """Evaluate records; `key` makes the ids of the picture its own in a page."""
    found = centre_files(given.files, given.request)
    numbers = sorted({1, len(found.setups)})
    ends = [found.setups[number - 1] for number in numbers]
    svg = inline(
        lambda: draw_polar(
            [s.fits[0] for s in ends],
            [s.heads[0].angle for s in ends],
            [f"in turn {number}" for number in numbers],
        ),
        key,
        "Error of the scale over the turn, polar, with the fitted curve, and its harmonics",
    )
    return CentreFound(of=given, result=found.to_dict(), svg=svg)


def likely_columns(path: Path) -> LikelyTurn:
    """Look into a file."""
    return likely_turn(contents(*read_whole(path)))


def gauge_record(text: str, factor: float, path: Path) -> None:
    """Write the readings of a gauge at even angles of one turn as a record.

    `factor` is how many metres the unit of the readings has.
    """
    words = re.split(r"[\s;]+", text.replace("\N{MINUS SIGN}", "-").strip())
    try:
        values = np.array([float(word.replace(",", ".")) for word in words if word])
    except ValueError:
        raise RecordError(
            f"the readings are numbers with spaces between, such as 12 8 -3, got '{text[:40]}'"
        ) from None
    if values.size < _FEWEST or not np.isfinite(values).all():
        raise RecordError(
            f"a turn takes {_FEWEST} readings or more, at even angles, got {values.size}"
        )
    angle = 2.0 * math.pi * np.arange(values.size) / values.size
    _write(path, angle, {"gauge": (factor * values, "m")})


def simulated_record(by: Sequence[float], index: int, path: Path) -> None:
    """Write what the heads of the example read after its stage moved so far, x and y [m]."""
    c, s = math.cos(_TURNED), math.sin(_TURNED)
    # mounted turned and mirrored, as a real one may be
    matrix = np.array([[c, s], [s, -c]]) @ np.diag(_GAINS)
    x, y = np.array(_CENTRE) + matrix @ np.asarray(by)
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
    count = np.arange(angle.size, dtype=np.float64)
    write_record(Record(channels=tuple(channels), time=count, over="point"), path)
