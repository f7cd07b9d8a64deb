"""What is called a traditional stage: open definitions, from the legs of the stage itself."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

from flexstage.base.errors import ModelError
from flexstage.hinges import RightCircular
from flexstage.stage import Stage
from flexstage.stage.designs.nested_xy import NestedXYParameters
from flexstage.stage.designs.nested_xy_axis import AxisParameters
from flexstage.stage.designs.pieces import Leg
from flexstage.stage.designs.registry import PARAMETER_SETS
from flexstage.stage.designs.two_guides import (
    SideBySideXYParameters,
    SingleAxisParameters,
    StackedXYParameters,
    plates,
    side_by_side_xy,
)
from flexstage.stage.drive import AnyActuator, ScrewActuator, StackActuator
from flexstage.studies.motion_errors import GuidedAxis, Mounting


@dataclass(frozen=True, slots=True, kw_only=True)
class CatalogueGuide:
    """A guide that one buys, by what its maker states."""

    title: str
    """What it is."""
    straightness: float
    """Largest deviation from a straight line that is stated [m]."""
    over: float
    """Length of the travel that it is stated for [m]; nothing is stated for less."""
    source: str
    """Where."""


#: A guide of rolling elements, for which nothing is computed here.
CROSSED_ROLLERS = CatalogueGuide(
    title="crossed rollers (by their maker)",
    straightness=1e-6,
    over=0.1,
    source="A. Bromme, G. Jaffe, Achieving high precision in linear stages without costly air "
    "bearings, Steinmeyer, 2012, names straightness within 1 µm over 100 mm as what crossed-roller "
    "stages are built for",
)


def guides_on_one_side(stage: Stage) -> Stage:
    """Return a nested stage without the guide legs on one side of each axis."""
    gone = {body.name for body in stage.bodies if body.name[1:] in ("G0d", "G1d")}
    return replace(
        stage,
        name=f"{stage.name}-one-sided",
        bodies=tuple(body for body in stage.bodies if body.name not in gone),
        hinges=tuple(hinge for hinge in stage.hinges if not gone & set(hinge.bodies)),
        published=(),
    )


def single_axis_guides(
    stage: Stage, guide: str, travel: Mapping[str, float]
) -> dict[str, SingleAxisParameters]:
    """Return guides with the legs of each axis of a nested stage, driven directly.

    Notches, length and spacing of legs are those of the axis, the platform as high as the one that
    carries what is positioned; the actuator is of the same kind and goes as far as that does.
    """
    platform = stage.body("PY").outline.points
    height = max(x for x, _ in platform) - min(x for x, _ in platform)
    found = {}
    for name, far in travel.items():
        of_axis = axis_dimensions(stage, name)
        first, second = (stage.hinge(f"{name}gp{i}-u").at for i in (0, 1))
        actuator, length = direct_actuator(of_axis.actuator, of_axis.actuator_pocket_length, far)
        found[name] = SingleAxisParameters(
            guide=guide,  # type: ignore[arg-type]
            leg=guide_leg(of_axis),
            leg_spacing=math.dist(first, second),
            platform_height=height,
            actuator=actuator,
            actuator_length=length,
        )
    return found


def direct_actuator(
    actuator: AnyActuator, length: float, travel: float
) -> tuple[AnyActuator, float]:
    """Return an actuator that makes a travel [m] itself, and its length [m].

    Of a screw more or less is turned in; a stack grows with its stroke, and its stiffness falls.

    Examples
    --------
    >>> stack = StackActuator(free_stroke=38e-6, stiffness=43e6)
    >>> longer, length = direct_actuator(stack, 36e-3, 65e-6)
    >>> print(f"{length * 1e3:.1f} mm, {longer.stiffness * 1e-6:.1f} N/um")
    61.6 mm, 25.1 N/um
    """
    if isinstance(actuator, ScrewActuator):
        return replace(actuator, travel=travel), length
    if isinstance(actuator, StackActuator):
        more = travel / actuator.free_stroke
        longer = replace(actuator, free_stroke=travel, stiffness=actuator.stiffness / more)
        return longer, length * more
    raise ModelError(f"an actuator of the kind '{actuator.kind}' has no stroke to set")


def traditional_axes(
    stage: Stage, travel: Mapping[str, float]
) -> Iterator[tuple[str, dict[str, GuidedAxis]]]:
    """Give every kind of traditional stage: what it is, and its axes.

    The platform of a double parallelogram is enclosed by its base, so none has another beside it.
    """
    plate = {"thickness": stage.thickness, "material": stage.material}
    single, double = (
        single_axis_guides(stage, guide, travel)
        for guide in ("parallelogram", "double-parallelogram")
    )
    for title, guides in (
        ("stacked parallelograms", single),
        ("stacked double parallelograms", double),
    ):
        stack = StackedXYParameters(**guides, **plate)
        lower, upper = plates(stack)
        low, high = stack.heights
        yield (
            title,
            {
                "x": GuidedAxis(stage=lower, axis="x", offset=(0.0, 0.0, low)),
                "y": GuidedAxis(
                    stage=upper, axis="x", offset=(0.0, 0.0, high), mounting=Mounting(), stream=1
                ),
            },
        )
    beside = side_by_side_xy(SideBySideXYParameters(**single, **plate))
    yield (
        "parallelograms side by side",
        {
            name: GuidedAxis(stage=beside, axis=name, offset=(0.0, 0.0, 0.5 * stage.thickness))
            for name in travel
        },
    )


def axis_dimensions(stage: Stage, axis: str) -> AxisParameters:
    """Return the dimensions of an axis of a built-in nested stage."""
    parameters: NestedXYParameters = PARAMETER_SETS[stage.name].parameters
    return {"x": parameters.x, "y": parameters.y}[axis]


def guide_leg(of_axis: AxisParameters) -> Leg:
    """Return the guide legs of an axis of a nested stage."""
    notch = RightCircular(neck_thickness=of_axis.leg_neck, radius=of_axis.leg_notch_radius)
    return Leg(notch=notch, bar_length=of_axis.leg_bar_length)
