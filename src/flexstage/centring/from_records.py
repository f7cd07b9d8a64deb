"""From records of an error over the turn to what is said of the scale: one way for all who ask."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from flexstage.centring.geometry import SCALE_KINDS
from flexstage.centring.record_heads import (
    MAGNET,
    doubts,
    each_has_one,
    head_angles,
    head_of,
    kind_notes,
    spelled,
)
from flexstage.centring.setting import Setting, fit_setting
from flexstage.centring.setting_results import change, joined, report
from flexstage.centring.trial_results import trial
from flexstage.errors import ModelError, RecordError
from flexstage.records import Record
from flexstage.records.reading_options import column, column_list

_DIRECTIONS = ("ccw", "cw")


@dataclass(frozen=True, slots=True, kw_only=True)
class CentreOptions:
    """Which columns of records are the error of a scale, where its heads stand, and what it is.

    Raises
    ------
    ModelError
        Options say what there is not, or do not belong together.
    RecordError
        Columns or turns are missing, or said twice.
    """

    error: str | None = None
    """Columns of errors, separated by commas."""
    reading: str | None = None
    """Columns of readings instead, of which the true angle is taken away."""
    angle: str | None = None
    """Column of the true angle."""
    unit: str | None = None
    """Unit of both."""
    angle_unit: str | None = None
    """Unit of the angle."""
    error_unit: str | None = None
    """Unit of errors or readings."""
    counts: float | None = None
    """Counts in a turn."""
    heads: str | None = None
    """Where the heads stand, separated by commas."""
    radius: float | None = None
    """Radius at which the scale is read [m]."""
    kind: str | None = None
    """disc, drum or magnet."""
    orders: Sequence[int] | None = None
    """Orders that are fitted."""
    turns: float | None = None
    """Number of turns, without a column of the angle."""
    sign: int = 1
    """-1 where errors are true angle less angle that was read."""
    head_direction: str = "ccw"
    """How the heads travel round the scale, ccw or cw."""
    stage_at: Sequence[tuple[float, float]] | None = None
    """Where the stage stood at each setting [m]."""
    mount: float = 0.0
    """Direction of the stage's x axis in the frame that turns with the table [rad]."""
    outliers: bool = True
    """Whether outliers are found and set aside."""

    def __post_init__(self) -> None:
        kinds = (*SCALE_KINDS, MAGNET)
        if self.sign not in (1, -1):
            raise ModelError(f"--sign must be 1 or -1, got {self.sign}")
        if self.head_direction not in _DIRECTIONS:
            raise ModelError(f"--head-direction must be ccw or cw, got '{self.head_direction}'")
        if self.kind is not None and self.kind not in kinds:
            raise ModelError(f"--kind must be one of {', '.join(kinds)}, got '{self.kind}'")
        _require_angle(self.angle, self.turns)
        _require_columns(self)
        if self.kind == MAGNET and self.radius is not None:
            raise ModelError(
                "a magnet on the axis has no radius that its error could be turned into "
                "micrometres by, and its harmonic of order 1 is that of offsets of its signals as "
                "well: leave --radius and --diameter out, and find the gain by trial moves "
                "(--stage-at)"
            )

    @property
    def names(self) -> list[str | int]:
        """The columns of errors or readings."""
        return column_list(self.error or self.reading)

    @property
    def columns(self) -> list[str | int]:
        """The columns that are read."""
        return self.names if self.angle is None else [column(self.angle), *self.names]

    @property
    def units(self) -> list[str | None]:
        """The unit of each of them, where records know it."""
        own = [] if self.angle is None else [spelled(self.angle_unit)]
        return [*own, *[spelled(self.error_unit)] * len(self.names)]


@dataclass(frozen=True, slots=True, kw_only=True)
class CentredRecords:
    """What records say of a scale."""

    settings: list[Setting]
    """The scale in each place."""
    reports: list[dict[str, Any]]
    """What is said of each, as plain data."""
    notes: tuple[str, ...]
    """What a reader should know of the records."""
    trial: dict[str, Any] | None
    """How the harmonics follow the positions of the stage, where those were given."""

    @property
    def result(self) -> dict[str, Any]:
        """All of it as plain data, as `flexstage centre --json` prints it."""
        result = joined(self.reports, self.notes)
        return result if self.trial is None else result | {"trial": self.trial}


def centre_records(records: Sequence[Record], options: CentreOptions) -> CentredRecords:
    """Return the eccentricity of a scale and the move that removes it.

    Several records are the heads of one setting if each column has an angle of its own, else
    settings in sequence.
    """
    names = options.names
    at = head_angles(options.heads, len(records), len(names))
    mirror = -1.0 if options.head_direction == "cw" else 1.0
    units = (options.angle_unit, options.error_unit, options.unit, options.counts)
    pairs = [(record, name) for record in records for name in names]
    found = [
        head_of(
            record,
            name,
            None if options.angle is None else column(options.angle),
            options.turns,
            units,
            alpha * mirror,
            reading=options.reading is not None,
            sign=options.sign,
        )
        for (record, name), alpha in zip(pairs, at, strict=True)
    ]
    together = len(records) > 1 and options.heads and each_has_one(options.heads, found)
    size = len(found) if together else len(names)
    settings = [_fitted(found[i : i + size], options) for i in range(0, len(found), size)]
    written = options.error_unit or options.unit
    reports = [report(s, mirror, options.mount, written) for s in settings]
    for i in range(1, len(reports)):
        reports[i]["change"] = change(settings[i - 1], settings[i], mirror, written)
    moves = options.stage_at
    if moves is not None and (len(moves) != len(settings) or len(settings) < 3):
        raise RecordError(
            f"--stage-at needs a position for each setting, and three settings at least: got "
            f"{len(moves)} positions and {len(settings)} settings"
        )
    return CentredRecords(
        settings=settings,
        reports=reports,
        notes=(*(note for r in records for note in r.notes), *doubts(found)),
        trial=None if moves is None else trial(settings, moves, options.kind),
    )


def _fitted(heads: list[Any], options: CentreOptions) -> Setting:
    orders = None if options.orders is None else list(options.orders)
    one = fit_setting(heads, options.radius, options.kind, orders, options.outliers)
    # of settings at known positions the kind says nothing that they do not say themselves
    known = options.stage_at is not None
    more = [] if known else kind_notes(one, options.kind, options.radius is not None)
    return replace(one, notes=tuple(dict.fromkeys((*one.notes, *more))))


def _require_columns(options: CentreOptions) -> None:
    error, reading = options.error, options.reading
    if (error is None) == (reading is None):
        raise RecordError(
            "give the columns of errors by --error, or those of what was read by --reading"
            + ("" if error is None else ", not both")
        )
    if reading is not None and options.angle is None:
        raise RecordError("--reading needs the true angle beside it: name its column by --angle")
    if reading is not None and options.sign != 1:
        raise RecordError("--reading gives errors of angle read less true angle: leave --sign out")
    if not options.names:
        raise RecordError(f"--{'error' if reading is None else 'reading'} must name a column")


def _require_angle(angle: str | None, turns: float | None) -> None:
    if angle is None and turns is None:
        raise RecordError(
            "give the column of the angle by --angle, or, for samples that are evenly spaced, the "
            "number of turns by --turns"
        )
    if angle is not None and turns is not None:
        raise RecordError("--angle says how many turns there are: leave --turns out")
    if turns is not None and not 0.9 <= turns < math.inf:
        raise RecordError(f"--turns must be 0.9 or more, got {turns:g}")
