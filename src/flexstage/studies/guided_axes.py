"""Guided axes: their motion errors, and the axes of traditional stages.

Motion errors come from geometry, bending, manufacture and assembly. A traditional stage has the
legs of the stage with which it is compared.
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from flexstage.base.arrays import Array
from flexstage.base.errors import ModelError
from flexstage.base.short_repr import short_repr
from flexstage.hinges import RightCircular
from flexstage.lumped import lumped_system, stroke_path
from flexstage.lumped.large_displacement import StrokePath
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
from flexstage.system import MechanicalSystem, static_displacements
from flexstage.virtual.imperfections import Scatter
from flexstage.virtual.scattered_motion import (
    ErrorMotion,
    draw_deviations,
    drive_of,
    error_motion,
    motion_rates,
)

if TYPE_CHECKING:
    from flexstage.fem.stroke import FiniteStroke

#: Number of samples for median and 95 % quantile.
SAMPLES = 300


@dataclass(frozen=True, slots=True, kw_only=True)
class Mounting:
    """Assembly errors of parts that are screwed together.

    Examples
    --------
    >>> print(f"{Mounting().squareness * 1e6:.0f} urad")
    56 urad
    """

    squareness: float = math.radians(20.0 / 3600.0) / math.sqrt(3.0)
    """Standard deviation of the angle between two guides [rad]. Precision XY tables keep it below
    20 arcsec (Dover Motion, Motion Control Handbook, linear positioning accuracy), assumed uniform.
    """
    tilt: float = math.radians(20.0 / 3600.0) / math.sqrt(3.0)
    """Standard deviation of the tilt of their planes [rad]; no published value."""


@dataclass(frozen=True, slots=True, kw_only=True)
class GuidedAxis:
    """An axis of a stage with its point of interest."""

    stage: Stage
    """The plate of the axis."""
    axis: str
    """Name of the axis in the stage."""
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Abbe offset of the point of interest: along the axis, to its left, along the normal [m]."""
    mounting: Mounting | None = None
    """Mounting on the axis below; None for a monolithic stage."""
    stream: int = 0
    """Stream of random numbers of the plate."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class AxisErrors:
    """Motion errors of one axis over its travel; arrays have a value per sample, shape (s,)."""

    travel: float
    """Travel of the point of interest [m]."""
    geometry: float
    """Transverse motion of the nominal stage by finite rotations, peak to valley [m]."""
    bending: float
    """Transverse motion at full travel due to elastic bodies [m]."""
    manufacture: float
    """Standard deviation of the transverse motion of the probe at full travel, by scatter [m]."""
    assembly: float
    """Standard deviation due to mounting, and to rotation errors times the Abbe offset [m]."""
    across: Array
    """Transverse motion in the plane, peak to valley [m]."""
    straightness: Array
    """Straightness error about the least-squares line [m]."""
    normal: Array
    """Out-of-plane motion, peak to valley [m]."""
    yaw: Array
    """Yaw, peak to valley [rad]."""
    tilt: Array
    """Larger of roll and pitch, peak to valley [rad]."""
    coupling: float
    """Transverse motion per metre of travel, nominal stage, small displacements [1]."""
    finite_elements: bool
    """True if finite elements with finite displacements gave the nominal path."""

    __repr__ = short_repr

    def figures(self, name: str) -> tuple[float, float]:
        """Return median and 95 % quantile over the samples of an error, by its name."""
        values = getattr(self, name)
        return float(np.median(values)), float(np.quantile(values, 0.95))


def plane_rates(system: MechanicalSystem, stage: Stage, axis: str) -> tuple[float, float]:
    """Return transverse motion [m/m] and rotation [rad/m] of a probe's body along an axis.

    They are per metre of the reading, for small displacements, with the other drives removed.
    """
    port = next(a for a in system.axes if a.name == axis)
    state = static_displacements(system, {port.drive: 1e-6})
    probe = stage.probe(port.probe)
    if probe.relative_to is not None or probe.direction is None:
        raise ModelError(
            f"probe '{probe.name}' must measure a displacement against the ground, for the "
            "motion errors of an axis"
        )
    x, y, turned = state.body_motion[probe.body]
    centre = next(b.centre for b in system.bodies if b.name == probe.body)
    x -= turned * (probe.at[1] - centre[1])
    y += turned * (probe.at[0] - centre[0])
    c, s = math.cos(probe.direction), math.sin(probe.direction)
    along = state.readings[probe.name]
    return (c * y - s * x) / along, turned / along


def axis_errors(
    guided: GuidedAxis,
    travel: float,
    bodies: MechanicalSystem,
    scatter: Scatter | None = None,
    *,
    path: "FiniteStroke | None" = None,
    samples: int = SAMPLES,
    seed: int = 1,
) -> AxisErrors:
    r"""Return the motion errors of an axis in many manufactured samples of a stage.

    The transverse motion of the point of interest of a sample is

    .. math:: v(u) = v_{geometry}(u) + (c_{bending} + c_{sample})\,u + (\theta(u)\times r)_v

    The terms are the path of rigid bodies by finite rotations, the effect of elastic bodies per
    metre (finite elements less rigid bodies), that of the scatter of this sample (lumped model in
    space), and the rotations times the Abbe offset r. They are added with their signs for each
    sample. The first two are equal in all samples; a path of elastic bodies with finite
    displacements, if given, replaces both.

    Parameters
    ----------
    guided : GuidedAxis
        The axis.
    travel : float
        Travel [m].
    bodies : MechanicalSystem
        Model of the stage with elastic bodies.
    scatter : Scatter, optional
        Scatter of the process; that of wire erosion by default.
    path : FiniteStroke, optional
        Stroke by finite elements with finite displacements.
    samples : int
        Number of samples.
    seed : int
        Seed of the deviations.

    Returns
    -------
    AxisErrors
        Error contributions, and the errors of each sample.

    Raises
    ------
    ConvergenceError
        The path cannot be followed over the travel.
    ModelError
        The axis has no drive with a displacement, or its probe is not relative to the ground.

    Notes
    -----
    Validity: effects of misplaced necks that are quadratic in the travel are neglected (a hundredth
    of the linear ones, for 3 um and legs of 30 mm). Legs on two sides of a platform stretch as it
    moves, which only the path of finite elements includes: its transverse motion is up to half as
    large again. Out-of-plane motion comes from tilted hinges and drives alone, not from gravity or
    an uneven base.
    """
    steps = 11  # states along a stroke
    stage, process = guided.stage, scatter or Scatter()
    axis = stage.axis(guided.axis)
    drive, rigid = drive_of(axis), lumped_system(stage)
    ratio = static_displacements(rigid, {drive: 1e-6}).readings[axis.probe] / 1e-6
    rigid_path = stroke_path(stage, drive, axis.probe, np.linspace(0.0, travel / ratio, steps))
    elastic, stiff = (plane_rates(m, stage, axis.name) for m in (bodies, rigid))
    mean = {"across": elastic[0] - stiff[0], "yaw": elastic[1] - stiff[1]}
    nominal_path: StrokePath | FiniteStroke = rigid_path
    if path is not None:
        nominal_path, mean = path, {}
    curve = (nominal_path.along, nominal_path.across, nominal_path.rotation)
    nominal_rates = motion_rates(stage)[axis.name]
    deviations = draw_deviations(stage, process, samples, seed=seed, stream=guided.stream)
    rates = motion_rates(stage, deviations)[axis.name] - nominal_rates
    at_probe = error_motion(*curve, rates, mean)
    moved = at_probe.at(guided.offset)
    nominal = error_motion(*curve, 0.0 * nominal_rates, mean).at(guided.offset)
    if guided.mounting is not None:
        # the key has one number, those of the samples have two
        rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(guided.stream,)))
        misalignment = rng.standard_normal((samples, 2))
        moved = moved.with_assembly(
            guided.mounting.squareness * misalignment[:, 0],
            guided.mounting.tilt * misalignment[:, 1],
        )
    probe, end = (m.displacement[:, -1, 1] for m in (at_probe, moved))
    return AxisErrors(
        travel=travel,
        geometry=float(np.ptp(rigid_path.across)),
        bending=float(nominal.displacement[0, -1, 1] - rigid_path.across[-1]),
        manufacture=float(np.std(probe)),
        assembly=float(np.std(end - probe)),
        across=np.ptp(moved.displacement[..., 1], axis=1),
        straightness=_straightness(moved),
        normal=np.ptp(moved.displacement[..., 2], axis=1),
        yaw=np.ptp(moved.rotation[..., 2], axis=1),
        tilt=np.ptp(moved.rotation[..., :2], axis=1).max(axis=1),
        coupling=elastic[0] + guided.offset[0] * elastic[1],
        finite_elements=path is not None,
    )


def _straightness(motion: ErrorMotion) -> Array:
    """Straightness error of each sample about its least-squares line."""
    across = motion.displacement[..., 1]
    design = np.stack((np.ones_like(motion.along), motion.along), axis=1)
    fit, *_ = np.linalg.lstsq(design, across.T, rcond=None)
    return np.asarray(np.ptp(across - (design @ fit).T, axis=1))


@dataclass(frozen=True, slots=True, kw_only=True)
class CatalogueGuide:
    """A commercial guide, by the data of its manufacturer."""

    title: str
    """Name of the guide."""
    straightness: float
    """Specified straightness [m]."""
    over: float
    """Travel of that specification [m]."""
    source: str
    """Source of the data."""


#: A guide with rolling elements, by its specification alone.
CROSSED_ROLLERS = CatalogueGuide(
    title="crossed rollers (by their maker)",
    straightness=1e-6,
    over=0.1,
    source="A. Bromme, G. Jaffe, Achieving high precision in linear stages without costly air "
    "bearings, Steinmeyer, 2012: straightness of crossed-roller stages within 1 µm over 100 mm",
)


def guides_on_one_side(stage: Stage) -> Stage:
    """Return a nested stage without the guide legs on one side of each axis."""
    removed = {body.name for body in stage.bodies if body.name[1:] in ("G0d", "G1d")}
    return replace(
        stage,
        name=f"{stage.name}-one-sided",
        bodies=tuple(body for body in stage.bodies if body.name not in removed),
        hinges=tuple(hinge for hinge in stage.hinges if not removed & set(hinge.bodies)),
        published=(),
    )


def single_axis_guides(
    stage: Stage, guide: str, travel: Mapping[str, float]
) -> dict[str, SingleAxisParameters]:
    """Return directly driven guides with the legs of each axis of a nested stage.

    Notches, length and spacing of legs are those of the axis, the height of the platform that of
    the sample platform. The actuator is of the same kind, with a stroke equal to the travel.
    """
    platform = stage.body("PY").outline.points
    height = max(x for x, _ in platform) - min(x for x, _ in platform)
    guides = {}
    for name, distance in travel.items():
        of_axis = axis_dimensions(stage, name)
        first, second = (stage.hinge(f"{name}gp{i}-u").at for i in (0, 1))
        actuator, length = direct_actuator(
            of_axis.actuator, of_axis.actuator_pocket_length, distance
        )
        guides[name] = SingleAxisParameters(
            guide=guide,  # type: ignore[arg-type]
            leg=guide_leg(of_axis),
            leg_spacing=math.dist(first, second),
            platform_height=height,
            actuator=actuator,
            actuator_length=length,
        )
    return guides


def direct_actuator(
    actuator: AnyActuator, length: float, travel: float
) -> tuple[AnyActuator, float]:
    """Return an actuator whose stroke is a travel [m], and its length [m].

    A screw keeps its length. The length of a stack grows with the stroke, and its stiffness falls.

    Examples
    --------
    >>> stack = StackActuator(free_stroke=38e-6, stiffness=43e6)
    >>> long_stack, length = direct_actuator(stack, 36e-3, 65e-6)
    >>> print(f"{length * 1e3:.1f} mm, {long_stack.stiffness * 1e-6:.1f} N/um")
    61.6 mm, 25.1 N/um
    """
    if isinstance(actuator, ScrewActuator):
        return replace(actuator, travel=travel), length
    if isinstance(actuator, StackActuator):
        ratio = travel / actuator.free_stroke
        stack = replace(actuator, free_stroke=travel, stiffness=actuator.stiffness / ratio)
        return stack, length * ratio
    raise ModelError(f"an actuator of the kind '{actuator.kind}' has no adjustable stroke")


def traditional_axes(
    stage: Stage, travel: Mapping[str, float]
) -> Iterator[tuple[str, dict[str, GuidedAxis]]]:
    """Yield each kind of traditional stage: its title and axes.

    The base of a double parallelogram encloses its platform, so that two cannot be side by side.
    """
    plate: dict[str, Any] = {"thickness": stage.thickness, "material": stage.material}
    single, double = (
        single_axis_guides(stage, guide, travel)
        for guide in ("parallelogram", "double-parallelogram")
    )
    for title, guides in (
        ("stacked parallelograms", single),
        ("stacked double parallelograms", double),
    ):
        stack = StackedXYParameters(x=guides["x"], y=guides["y"], **plate)
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
    pair = side_by_side_xy(SideBySideXYParameters(x=single["x"], y=single["y"], **plate))
    yield (
        "parallelograms side by side",
        {
            name: GuidedAxis(stage=pair, axis=name, offset=(0.0, 0.0, 0.5 * stage.thickness))
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
