"""What is asked of a stage for other programs."""

from dataclasses import dataclass, field
from typing import Annotated, ClassVar, Literal

from flexstage.errors import ModelError
from flexstage.export.formats import FORMATS
from flexstage.files.ranges import INNER_SHARE, POSITIVE, Size, Written
from flexstage.files.request import Request
from flexstage.hysteresis.requests import DynamicRequest
from flexstage.studies.requests import ModelName
from flexstage.units import DIMENSIONS

_ALL = "all"


def read_formats(text: str) -> tuple[str, ...]:
    """Return the formats of a list, each once, in the order of the list; or ``all`` alone."""
    names = tuple(dict.fromkeys(part.strip() for part in text.split(",")))
    for name in names:
        if name not in FORMATS and names != (_ALL,):
            raise ModelError(
                f"must be one or more of {', '.join(FORMATS)}, separated by commas, or all, got "
                f"'{name[:40]}'"
            )
    return names


@dataclass(frozen=True, slots=True, kw_only=True)
class TimeRequest(DynamicRequest):
    """A stage that runs in time, with what its stacks and sensors do."""

    heading: ClassVar[str] = "Formats that run in time (diagram, simulink, fmu, mat, c)"

    hysteresis: Annotated[tuple[str, ...], Written("usual|none|NAME=FILE")] = ()
    """Hysteresis of the piezo stacks: a Bouc-Wen loop of usual width, none, or the model file of
    'flexstage identify' for a drive or axis (default: usual).
    """
    creep: Annotated[float, INNER_SHARE, Written("SHARE")] | None = None
    """Creep of the stacks per decade of time, such as "1.5%" (default: no creep)."""
    sensor_bandwidth: (
        Annotated[float, DIMENSIONS["frequency"], POSITIVE, Written(bare="Hz")] | None
    ) = None
    """Bandwidth of the sensors (default: readings equal the true motion)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ExportRequest(Request):
    """A stage for other programs."""

    to: Annotated[tuple[str, ...], Written("|".join(FORMATS), read=read_formats, write=",".join)]
    """Format; several separated by commas; 'all' writes every format that the stage allows."""
    model: ModelName = "superelement"
    """The model."""
    plane: Literal["auto", "stress", "strain"] = "auto"
    """Plane state of the notches; auto decides by the ratio of width to neck."""
    fmi: Literal["2.0", "3.0", "both"] = "both"
    """FMI version of the FMU."""
    source_only: bool = False
    """Write the FMU with C sources only, without a compiled library."""
    precision: Literal["double", "single"] = "double"
    """Floating-point precision of the C header."""
    kerf: Annotated[Size, Written(bare="m")] | None = None
    """Kerf of wire cutting, such as "0.28 mm"; adds the wire path to the DXF."""
    time: TimeRequest = field(default_factory=TimeRequest)
    """How it runs in time."""

    @property
    def formats(self) -> tuple[str, ...]:
        """Names of the formats."""
        return tuple(FORMATS) if self.every_format else self.to

    @property
    def every_format(self) -> bool:
        """Whether every format is asked for that the stage allows."""
        return self.to == (_ALL,)

    @property
    def fmi_versions(self) -> tuple[Literal["2.0", "3.0"], ...]:
        """Versions of FMI of the FMU."""
        return ("2.0", "3.0") if self.fmi == "both" else (self.fmi,)
