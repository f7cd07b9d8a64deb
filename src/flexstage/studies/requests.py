"""What is asked of models of a stage."""

from typing import Annotated, Literal

from flexstage.files.ranges import Written

#: A model, by the word for it.
ModelName = Annotated[
    Literal["lumped", "superelement", "plane", "superelement-3d", "solid"],
    Written(
        help="lumped: rigid bodies joined by hinges, for thousands of variants and equations; "
        "superelement or, in space, superelement-3d: finite elements with condensed bodies, for "
        "all usual work; plane or, in space, solid: finite elements of the whole, as the "
        "reference; plane also for large displacement."
    ),
]
