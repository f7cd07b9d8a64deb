"""Motion errors of an axis from what is known of its stage: geometry, bending, manufacture."""

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from flexstage.base.arrays import Array
from flexstage.base.errors import ModelError
from flexstage.base.short_repr import short_repr
from flexstage.lumped import lumped_system, stroke_path
from flexstage.lumped.large_displacement import StrokePath
from flexstage.stage import Stage
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

#: Samples whose median and 95 % quantile are given.
SAMPLES = 300


@dataclass(frozen=True, slots=True, kw_only=True)
class Mounting:
    """How far parts that are screwed together are off from each other.

    Examples
    --------
    >>> print(f"{Mounting().squareness * 1e6:.0f} urad")
    56 urad
    """

    squareness: float = math.radians(20.0 / 3600.0) / math.sqrt(3.0)
    """Standard deviation of the angle between two guides [rad]. Precision XY tables keep it below
    20 arcsec (Dover Motion, Motion Control Handbook, linear positioning accuracy), any value alike.
    """
    tilt: float = math.radians(20.0 / 3600.0) / math.sqrt(3.0)
    """The same of the tilt of their planes [rad], for which nothing is stated."""


@dataclass(frozen=True, slots=True, kw_only=True)
class GuidedAxis:
    """An axis of a stage, and the point whose motion matters."""

    stage: Stage
    """The plate that it is part of."""
    axis: str
    """Its name there."""
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """The point of interest from the probe: along the axis, to its left, along the normal [m]."""
    mounting: Mounting | None = None
    """How it is mounted on the axis below it; None where both are of one piece."""
    stream: int = 0
    """Stream of random numbers of its plate."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class AxisErrors:
    """Motion errors of one axis over its travel; arrays are of the samples, shape (s,)."""

    travel: float
    """How far the point of interest goes [m]."""
    geometry: float
    """Motion across by finite rotations of the stage as drawn, largest less smallest [m]."""
    bending: float
    """Motion of the point across at full travel that elastic bodies add to rigid ones [m]."""
    manufacture: float
    """Standard deviation of the motion of the probe across at full travel, by scatter [m]."""
    assembly: float
    """Standard deviation of what mounting, and scattered rotations times the offset, add [m]."""
    across: Array
    """Motion across the axis in the plane, largest less smallest [m]."""
    straightness: Array
    """The same against the least-squares straight line [m]."""
    normal: Array
    """Motion along the normal, largest less smallest [m]."""
    yaw: Array
    """Rotation in the plane, largest less smallest [rad]."""
    tilt: Array
    """Larger of roll and pitch, largest less smallest [rad]."""
    coupling: float
    """Motion across for each metre along, of the stage as drawn, small displacements [1]."""
    finite_elements: bool
    """Whether the path as drawn is that of finite elements with finite displacements."""

    __repr__ = short_repr

    def figures(self, what: str) -> tuple[float, float]:
        """Return median and 95 % quantile of one of the figures of the samples, by its name."""
        values = getattr(self, what)
        return float(np.median(values)), float(np.quantile(values, 0.95))


def plane_rates(system: MechanicalSystem, stage: Stage, axis: str) -> tuple[float, float]:
    """Return motion to the left [m/m] and rotation [rad/m] of a probe's body along an axis.

    For each metre that the probe reads, small displacements, the other drives removed.
    """
    port = next(a for a in system.axes if a.name == axis)
    state = static_displacements(system, {port.drive: 1e-6})
    probe = stage.probe(port.probe)
    if probe.relative_to is not None or probe.direction is None:
        raise ModelError(
            f"probe '{probe.name}' must read a displacement against the ground, to tell what an "
            "axis does beside its motion"
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
    r"""Return what an axis does beside its motion, of many stages as they are made.

    Of every sample the motion of the point of interest is

    .. math:: v(u) = v_{geometry}(u) + (c_{bending} + c_{sample})\,u + (\theta(u)\times r)_v

    with the path of rigid bodies by finite rotations, what elastic bodies add to it for each metre
    (finite elements less rigid bodies), what the scatter of this sample adds (lumped model in
    space), and the rotations times the Abbe offset r. The parts are added with their signs, sample
    by sample: the first two are the same in all of them, and a path of elastic bodies with finite
    displacements stands for both of them where there is one.

    Parameters
    ----------
    guided : GuidedAxis
        The axis.
    travel : float
        How far it goes [m].
    bodies : MechanicalSystem
        A model of its stage with elastic bodies.
    scatter : Scatter, optional
        The process; the usual one where not given.
    path : FiniteStroke, optional
        Its stroke by finite elements with finite displacements.
    samples : int
        How many stages.
    seed : int
        Seed of their deviations.

    Returns
    -------
    AxisErrors
        The parts, and the whole of each sample.

    Raises
    ------
    ConvergenceError
        The path cannot be followed over the travel.
    ModelError
        The axis has no drive that can be imposed, or its probe is read from a body that moves.

    Notes
    -----
    Validity: what necks that are out of place do by the square of the travel is left out (a
    hundredth of what they do in proportion, for 3 um and legs of 30 mm). Where legs hold a platform
    from two sides they stretch as it moves, which rigid bodies and small displacements of elastic
    ones leave out: the path of finite elements goes up to half as far across again. Motion along
    the normal comes from leaning hinges and drives alone, not from gravity or an uneven base.
    """
    steps = 11  # states along a stroke
    stage, process = guided.stage, scatter or Scatter()
    axis = stage.axis(guided.axis)
    drive, rigid = drive_of(axis), lumped_system(stage)
    ratio = static_displacements(rigid, {drive: 1e-6}).readings[axis.probe] / 1e-6
    rigid_path = stroke_path(stage, drive, axis.probe, np.linspace(0.0, travel / ratio, steps))
    elastic, stiff = (plane_rates(m, stage, axis.name) for m in (bodies, rigid))
    mean = {"across": elastic[0] - stiff[0], "yaw": elastic[1] - stiff[1]}
    drawn_path: StrokePath | FiniteStroke = rigid_path
    if path is not None:
        drawn_path, mean = path, {}
    curve = (drawn_path.along, drawn_path.across, drawn_path.rotation)
    as_drawn = motion_rates(stage)[axis.name]
    deviations = draw_deviations(stage, process, samples, seed=seed, stream=guided.stream)
    rates = motion_rates(stage, deviations)[axis.name] - as_drawn
    at_probe = error_motion(*curve, rates, mean)
    moved = at_probe.at(guided.offset)
    drawn = error_motion(*curve, 0.0 * as_drawn, mean).at(guided.offset)
    if guided.mounting is not None:
        # a key of one number, where those of the samples have two
        rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(guided.stream,)))
        askew = rng.standard_normal((samples, 2))
        moved = moved.with_assembly(
            guided.mounting.squareness * askew[:, 0], guided.mounting.tilt * askew[:, 1]
        )
    probe, end = (m.displacement[:, -1, 1] for m in (at_probe, moved))
    return AxisErrors(
        travel=travel,
        geometry=float(np.ptp(rigid_path.across)),
        bending=float(drawn.displacement[0, -1, 1] - rigid_path.across[-1]),
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
    """Largest less smallest deviation of each sample from its least-squares straight line."""
    across = motion.displacement[..., 1]
    design = np.stack((np.ones_like(motion.along), motion.along), axis=1)
    fit, *_ = np.linalg.lstsq(design, across.T, rcond=None)
    return np.asarray(np.ptp(across - (design @ fit).T, axis=1))
