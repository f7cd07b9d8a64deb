"""The request for the equations of a stage."""

from dataclasses import dataclass
from typing import Annotated, Literal

from flexstage.files.ranges import Written
from flexstage.files.request import Request

#: Damping of equations in symbols.
DampingKind = Literal["rayleigh", "hinge", "none"]


@dataclass(frozen=True, slots=True, kw_only=True)
class EquationsRequest(Request):
    """Equations of motion in symbols."""

    to: Literal["text", "latex", "svg"] = "text"
    """Plain text, a LaTeX document, or the structural diagram of an axis as a drawing."""
    reduce: Literal["auto", "symmetry", "condense", "none"] = "auto"
    """Reduction of the coordinates for transfer functions; auto uses the symmetry of the stage if
    it leaves few enough coordinates, else condensation to drives and probes.
    """
    axis: Annotated[str, Written("NAME")] | None = None
    """Axis of the transfer function (default: all), or of the diagram."""
    damping: DampingKind = "rayleigh"
    """Damping model of the equations."""
