"""The models of a stage by their names, as requests ask for them."""

from collections.abc import Sequence
from typing import Annotated, Literal, get_args

from flexstage.files.ranges import Written

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
