"""What requests ask of a stage: its models by their names, and its equations."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Literal, get_args

from flexstage.files.ranges import Written
from flexstage.files.request import Request

_WHAT = (
    "lumped: rigid bodies joined by hinges, for thousands of variants and for equations; "
    "superelement or, in three dimensions, superelement-3d: condensed finite elements, for "
    "everyday work; plane or, in three dimensions, solid: finite elements of the entire stage, "
    "as a reference; plane also for large displacements."
)
_Model = Literal["lumped", "superelement", "plane", "superelement-3d", "solid"]
#: A model, by the word for it.
ModelName = Annotated[_Model, Written(help=_WHAT)]
#: Several models, or all.
ModelNames = Annotated[
    tuple[Literal[_Model, "all"], ...], Written("NAMES", commas=True, help=_WHAT)
]


def models_of(names: Sequence[str]) -> list[str]:
    """Return the models of a list of names, each once.

    Examples
    --------
    >>> models_of(("plane", "lumped", "plane"))
    ['plane', 'lumped']
    """
    return list(dict.fromkeys(get_args(_Model) if "all" in names else names))


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
