"""Requests for the analysis of records of a scale on a rotary table."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

from flexstage.base.errors import ModelError, RecordError
from flexstage.files.ranges import NOT_NEGATIVE, POSITIVE, Range, Share, Size, Written
from flexstage.files.request import Request
from flexstage.quantities.units import Angle, parse
from flexstage.records.read_options import Column, ColumnList

#: One pair of poles on the axis.
MAGNET = "magnet"
_POSITION_UNIT = "um"


def read_orders(text: str) -> tuple[int, ...]:
    """Return orders: "1:12", "1,2,4", or the highest alone.

    Examples
    --------
    >>> read_orders("1:4"), read_orders("3")
    ((1, 2, 3, 4), (1, 2, 3))
    """
    words = [word.strip() for word in text.replace(":", ",").split(",")]
    if not all(word.isdecimal() and 1 <= int(word) <= 10_000 for word in words):
        raise RecordError(f'must be such as "1:12" or "1,2,4", got \'{text}\'')
    orders = [int(word) for word in words]
    if ":" not in text:
        return tuple(orders) if "," in text else tuple(range(1, orders[0] + 1))
    if len(orders) != 2 or orders[0] > orders[1]:
        raise RecordError(f"must be a range such as \"1:12\", got '{text}'")
    return tuple(range(orders[0], orders[1] + 1))


def read_positions(text: str) -> tuple[tuple[float, float], ...]:
    """Return positions x, y of a stage [m], bare numbers in um."""
    pairs = [pair.split(",") for pair in text.split(";") if pair.strip()]
    if any(len(pair) != 2 for pair in pairs):
        raise RecordError(
            f"must have x,y for each setup, such as '0,0; 20,0; 0,20' in um, got '{text}'"
        )
    x, y = (
        [parse(p[k].strip(), "length", bare_unit=_POSITION_UNIT) for p in pairs] for k in (0, 1)
    )
    return tuple(zip(x, y, strict=True))


def _positions_text(positions: Sequence[tuple[float, float]]) -> str:
    return "; ".join(f"{x!r} m,{y!r} m" for x, y in positions)


def _orders_text(orders: Sequence[int]) -> str:
    return ",".join(map(str, orders)) if len(orders) > 1 else f"{orders[0]}:{orders[0]}"


#: Angles of the heads [rad].
HeadAngles = Annotated[tuple[Angle, ...], Written("ANGLES", bare="deg", commas=True)]
#: Radius at which a scale is read [m].
ScaleRadius = Annotated[Size, Written(bare="mm")]
#: Orientation of a stage on its table [rad].
MountingAngle = Annotated[Angle, Written(bare="deg")]


@dataclass(frozen=True, slots=True, kw_only=True)
class TurnRequest(Request):
    """Columns of records over a turn of a scale on a rotary table."""

    error: ColumnList = ()
    """Numbers or names of the error columns, one for each head: angle reading minus true angle; or,
    in a unit of length, the readings of indicators on the rim (default, with none of these options:
    the columns called angle and error).
    """
    reading: ColumnList = ()
    """Instead of --error: columns of the readings of the heads, wrapped at a turn or not; the true
    angle is subtracted.
    """
    angle: Column | None = None
    """Number or name of the column of the true angle, wrapped or not, with its unit if the file
    does not state it, such as "0 deg" (default: samples are evenly spaced over --turns).
    """
    unit: Annotated[str, Written("UNIT")] | None = None
    """Unit of angle and error if neither the file nor --angle and --error state it, such as "deg",
    "rad", "arcsec", "turn" or "count"; harmonics are printed in it.
    """
    counts: float | None = None
    """Counts per turn, for columns in counts."""
    heads: HeadAngles = ()
    """Angles of the heads or indicators in the room, bare numbers in degrees, such as
    "0,90,180,270".
    """
    orders: Annotated[tuple[int, ...], Written("RANGE", read=read_orders, write=_orders_text)] = ()
    """Orders to fit, such as "1:12" or "1,2,4" (default: 1:12, or fewer if there are few samples).
    """
    turns: Annotated[float, Range(low=0.9)] | None = None
    """Number of turns in the record, if there is no --angle."""
    sign: Annotated[int, Range(low=-1, high=1), Written("1|-1")] = 1
    """-1 if the errors are true angle minus angle reading: all printed and plotted values change
    their sign.
    """

    def __post_init__(self) -> None:
        super(TurnRequest, self).__post_init__()
        if self.sign == 0:
            raise ModelError("--sign must be 1 or -1, got 0")

    @property
    def names(self) -> tuple[str | int, ...]:
        """Columns of errors or readings."""
        return self.error or self.reading

    @property
    def columns(self) -> tuple[str | int, ...]:
        """All columns to read."""
        return self.names if self.angle is None else (self.angle, *self.names)


@dataclass(frozen=True, slots=True, kw_only=True)
class CentreRequest(TurnRequest):
    """Eccentricity of a scale on a rotary table, and the move that removes it."""

    radius: ScaleRadius | None = None
    """Radius at which the scale is read, such as "50 mm"; needed for the eccentricity."""
    kind: Literal["disc", "drum", "magnet"] | None = None
    """disc (default): radial lines or poles on a face, read at the radius; drum: lines or poles
    parallel to the axis on a rim; magnet: one pair of poles on the axis, whose harmonic of order 1
    is not eccentricity alone.
    """
    table: Annotated[str, Written("TABLE")] | None = None
    """Description of the rotary table (YAML), instead of --heads, --radius, --kind and
    --mounting-angle; its tolerance is the target.
    """
    head_direction: Literal["ccw", "cw"] = "ccw"
    """Direction in which the heads travel round the scale as the angle grows, seen in the frame x,
    y that turns with the table; head angles count in this direction. Over a table that turns
    counter-clockwise they travel cw.
    """
    stage_at: Annotated[
        tuple[tuple[float, float], ...],
        Written("X,Y;...", read=read_positions, write=_positions_text),
    ] = ()
    """Position of the stage in each setup, bare numbers in um, such as "0,0; 20,0; 0,20; 20,20":
    adds the orders that respond to the moves, their gain, and the centre, for any scale and without
    a radius.
    """
    mounting_angle: MountingAngle = 0.0
    """Direction of the x axis of the stage in the frame that turns with the table, such as
    "30 deg"; a bare number is in degrees.
    """
    outliers: bool = True
    """Find outliers, report them, and exclude them."""

    def __post_init__(self) -> None:
        super(CentreRequest, self).__post_init__()
        if self.kind == MAGNET and self.radius is not None:
            raise ModelError(
                "no radius converts the error of a magnet on the axis to micrometres, and signal "
                "offsets also contribute to its harmonic of order 1: omit --radius, and determine "
                "the gain by trial moves (--stage-at)"
            )


#: A standard uncertainty of an angle [rad].
_Uncertainty = Annotated[Angle, NOT_NEGATIVE, Written(bare="arcsec")]


@dataclass(frozen=True, slots=True, kw_only=True)
class CalibrateRequest(TurnRequest):
    """Calibration of a scale, of two scales, or of a polygon and its table."""

    method: Literal["self", "reference", "equal-division", "cross", "closure", "rosette"] | None = (
        None
    )
    """self: by the differences of two heads or more; reference: against the true angle;
    equal-division: mean of evenly spaced heads; cross: two scales in several --positions; closure:
    faces of a polygon by an unknown angle; rosette: polygon and table in several --settings
    (default: where the records allow only one).
    """
    positions: HeadAngles = ()
    """Angle of the second scale relative to the first in each column or file, bare numbers in
    degrees; errors are the first reading minus the second.
    """
    settings: Annotated[tuple[int, ...], Written("NUMBERS", commas=True)] = ()
    """Number of faces by which the polygon is turned on the table in each column, such as "0,1,4,6"
    (default: the numbers that end the names of the columns).
    """
    span: Annotated[int, Range(low=1)] = 1
    """Number of faces from one autocollimator to the other, for closure."""
    noise: Annotated[Angle, POSITIVE, Written(bare="arcsec")] | None = None
    """Standard deviation of a reading, a bare number in arcsec (default: from the residuals)."""
    head_uncertainty: _Uncertainty = 0.0
    """Standard uncertainty of the angle of each head, a bare number in arcsec."""
    blind_allowance: _Uncertainty = 0.0
    """Standard uncertainty for orders that the method cannot see, a bare number in arcsec."""
    gain_uncertainty: Share = 0.0
    """Relative standard uncertainty of the gain of the autocollimator, such as "0.1 %"."""
    axis_motion: bool = False
    """The axis of the table moves: solve for it at every sample."""
    best_heads: Annotated[int, Range(low=2)] | None = None
    """Without records: find the angles of this number of heads with the smallest uncertainty for
    --orders.
    """
    step: Annotated[Angle, POSITIVE, Written(bare="deg")] | None = None
    """Step of these angles, a whole part of a turn; a bare number is in degrees (default: 10)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CertificateRequest(Request):
    """Certificate of a calibration, if an object is named."""

    heading: ClassVar[str] = "Certificate"

    certificate: Annotated[str, Written("FILE")] | None = None
    """Write a certificate as one page (.html): object, standards, result, uncertainty, records."""
    item: str = ""
    """Object of the certificate: kind, maker and serial number."""
    standard: str = ""
    """Standards that were used, with their certificates."""
    traceability: str = ""
    """Traceability, as the laboratory states it."""
    conditions: str = ""
    """Conditions, such as "20.0 degC, humidity 45 %"."""
    laboratory: str = ""
    """Laboratory and person."""

    def __post_init__(self) -> None:
        super(CertificateRequest, self).__post_init__()
        if self.certificate is not None and not self.item:
            raise ModelError(
                'a certificate names its object: give --item, such as --item "scale, no. 123"'
            )
        stated = self.item, self.standard, self.traceability, self.conditions, self.laboratory
        if self.certificate is None and any(stated):
            raise ModelError("--item, --standard and others are for --certificate FILE: give it")


#: Without a certificate.
NO_CERTIFICATE = CertificateRequest()
