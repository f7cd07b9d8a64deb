"""A stage as a linear mechanical system, whatever model it comes from."""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal, TypeVar

import numpy as np

from flexstage.base.arrays import Array
from flexstage.base.errors import ModelError
from flexstage.base.short_repr import short_repr
from flexstage.stage.assumptions import DAMPING_RATIO
from flexstage.stage.drive import Drive, Force
from flexstage.stage.model import only_drive
from flexstage.system.stress_map import StressMap


class _Ratios(ABC):
    """Protocol of damping models; all of them keep the undamped mode shapes."""

    __slots__ = ()

    @abstractmethod
    def ratios(self, omega: Array, hinge_share: Array) -> Array:
        """Return the damping ratio of each mode.

        Parameters
        ----------
        omega : numpy.ndarray
            Angular natural frequencies [rad/s], shape (k,).
        hinge_share : numpy.ndarray
            Part of each mode's strain energy that is in the stage and not in the drives [1],
            shape (k,).

        Returns
        -------
        numpy.ndarray
            Damping ratios [1], shape (k,).
        """


@dataclass(frozen=True, slots=True, kw_only=True)
class ModalDamping(_Ratios):
    """The same damping ratio for every mode."""

    ratio: float
    """Damping ratio zeta [1]."""

    def __post_init__(self) -> None:
        if not 0.0 <= self.ratio < 1.0:
            raise ModelError(f"a damping ratio must be from 0 to below 1, got {self.ratio!r}")

    def ratios(self, omega: Array, hinge_share: Array) -> Array:
        del hinge_share
        return np.full_like(omega, self.ratio)


#: Assumed in the absence of a measurement.
DEFAULT_DAMPING = ModalDamping(ratio=DAMPING_RATIO)


@dataclass(frozen=True, slots=True, kw_only=True)
class RayleighDamping(_Ratios):
    """Viscous damping C = alpha M + beta K (Lord Rayleigh, The Theory of Sound, 1877, art. 97).

    K is that of the stage with the springs of the drives that are in place. The ratio of a mode is
    (alpha/omega + beta omega)/2.
    """

    alpha: float
    """Factor of the mass matrix [1/s]."""
    beta: float
    """Factor of the stiffness matrix [s]."""

    def __post_init__(self) -> None:
        if self.alpha < 0.0 or self.beta < 0.0:
            raise ModelError(
                f"Rayleigh's alpha and beta must not be negative, got {self.alpha!r}, {self.beta!r}"
            )

    def ratios(self, omega: Array, hinge_share: Array) -> Array:
        del hinge_share
        return 0.5 * (self.alpha / omega + self.beta * omega)


@dataclass(frozen=True, slots=True, kw_only=True)
class LossFactor(_Ratios):
    """Material damping of the hinges, as viscous damping that is exact at each resonance.

    The ratio of a mode is eta/2 times the share of its energy that is in the hinges.
    """

    eta: float
    """Loss factor of the hinge material [1]: energy lost in a cycle over 2 pi times the largest
    strain energy.
    """

    def __post_init__(self) -> None:
        if not 0.0 <= self.eta < 2.0:
            raise ModelError(f"a loss factor must be from 0 to below 2, got {self.eta!r}")

    def ratios(self, omega: Array, hinge_share: Array) -> Array:
        del omega
        return 0.5 * self.eta * hinge_share


Damping = ModalDamping | RayleighDamping | LossFactor

#: Condition of the drives: removed, installed with their stiffness, or locked at their length.
DriveCondition = Literal["removed", "in place", "locked"]

#: Standard acceleration of gravity [m/s^2] (3rd CGPM, 1901).
STANDARD_GRAVITY = 9.80665

#: Motion of the ground under a stage: along its axes, or rotation about its origin.
GroundDirection = Literal["x", "y", "rotation"]

_T = TypeVar("_T", bound=Any)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DrivePort:
    """Point of action of a drive."""

    name: str
    """Name of the drive."""
    vector: Array
    """Elongation of the drive for each coordinate [m], shape (n,); also the force of the
    coordinates for a unit force of the drive.
    """
    stiffness: float | None
    """Stiffness of the drive itself [N/m]; None if rigid, 0 if it is a pure force."""
    stroke: float | None = None
    """Largest free displacement [m]."""
    smallest_displacement: float | None = None
    """Smallest commanded change [m]."""
    largest_force: float | None = None
    """Largest force, of a drive that is a pure force [N]."""
    mass: float = 0.0
    """Mass, spread evenly over its length [kg]."""
    ends: Array | None = None
    """Displacement x, y of its end on the pushed body, then on the reacting one, for each
    coordinate [m], shape (2, 2, n); None without mass.
    """


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ProbePort:
    """Point of measurement."""

    name: str
    """Name of the probe."""
    vector: Array
    """Reading for each coordinate, shape (n,)."""
    unit: str = "m"
    """Unit of the reading."""
    body: str = ""
    """Body that is read."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BodyPort:
    """Motion of a body, for drawing and for rotations."""

    name: str
    """Name of the body."""
    centre: tuple[float, float]
    """The point whose displacement is given [m]."""
    matrix: Array
    """Displacement x, y [m] and rotation [rad] for each coordinate, shape (3, n)."""
    thermal: Array | None = None
    """Force on each coordinate for one kelvin of this body alone, shape (n,); None where bodies do
    not expand.
    """


def drive_port(drive: Drive, vector: Array, bodies: Sequence[BodyPort]) -> DrivePort:
    """Return the port of a drive with its seats, for its elongation and the motion of bodies."""
    mounted, motion = drive.mounted, {b.name: b for b in bodies}
    ends = None
    if drive.mass is not None:
        ends = np.zeros((2, 2, vector.size))
        for end, body, (x, y) in zip(ends, (drive.pushes, drive.reacts), drive.at, strict=True):
            if body in motion:  # else it is fixed
                port = motion[body]
                arm = np.array([port.centre[1] - y, x - port.centre[0]])
                end[:] = port.matrix[:2] + np.outer(arm, port.matrix[2])
    return DrivePort(
        name=drive.name,
        vector=vector,
        stiffness=mounted.stiffness,
        stroke=mounted.stroke,
        smallest_displacement=mounted.smallest_displacement,
        largest_force=drive.largest_force if isinstance(drive, Force) else None,
        mass=drive.mass or 0.0,
        ends=ends,
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LoadPort:
    """A load that acts on the whole stage, such as its weight or a change of temperature."""

    name: str
    """Name of the load."""
    vector: Array
    """Force on each coordinate for a load of one unit, shape (n,)."""
    unit: str
    """Unit of the load."""


@dataclass(frozen=True, slots=True, kw_only=True)
class AxisPort:
    """An axis of positioning."""

    name: str
    """Name of the axis."""
    drives: tuple[str, ...]
    """Drives that move it."""
    probe: str
    """Probe that reads it."""

    @property
    def drive(self) -> str:
        """The drive that moves it alone.

        Raises
        ------
        ModelError
            Several drives move it together.
        """
        return only_drive(self.name, self.drives, ModelError)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MechanicalSystem:
    r"""A linear mechanical system with named drives and probes.

    .. math:: M\ddot q + C\dot q + K q = \sum_i d_i F_i, \quad y_j = p_j^T q

    M and K are those of the bare stage: fixed bodies held, drives removed. A drive in place adds
    the spring :math:`k d d^T` and the input :math:`k d w` of its free displacement w.

    Raises
    ------
    ModelError
        The shapes do not fit, or the matrices are not symmetric.
    """

    name: str
    """Name of the stage."""
    model: str
    """Model that it comes from: lumped, superelement, plane, superelement-3d or solid."""
    M: Array
    """Mass matrix, shape (n, n)."""
    K: Array
    """Stiffness matrix, shape (n, n)."""
    coordinates: tuple[str, ...]
    """Name and unit of each coordinate."""
    drives: tuple[DrivePort, ...] = ()
    """Points of action of the drives."""
    probes: tuple[ProbePort, ...] = ()
    """Points of measurement."""
    bodies: tuple[BodyPort, ...] = ()
    """Motion of the bodies."""
    stress: StressMap | None = None
    """Stress in the hinges."""
    loads: tuple[LoadPort, ...] = ()
    """Loads on the whole stage."""
    axes: tuple[AxisPort, ...] = ()
    """Directions of positioning."""
    damping: Damping = DEFAULT_DAMPING
    """Damping."""
    validity: tuple[str, ...] = ()
    """Limits of validity of the model."""
    settings: Mapping[str, str] = field(default_factory=dict)
    """Choices of the model that change its figures."""

    __repr__ = short_repr

    def __post_init__(self) -> None:
        n = len(self.coordinates)
        for name, matrix in (("M", self.M), ("K", self.K)):
            if matrix.shape != (n, n):
                raise ModelError(f"{name} must have shape {(n, n)}, got {matrix.shape}")
            scale = np.abs(matrix).max(initial=0.0)
            if not np.allclose(matrix, matrix.T, rtol=0.0, atol=1e-9 * scale):
                raise ModelError(f"{name} must be symmetric")

    @property
    def order(self) -> int:
        """Number of coordinates n."""
        return len(self.coordinates)

    def drive(self, name: str) -> DrivePort:
        """Return a drive by name.

        Parameters
        ----------
        name : str
            Its name.

        Returns
        -------
        DrivePort
            The drive.
        """
        return find_named("drive", name, self.drives)

    def probe(self, name: str) -> ProbePort:
        """Return a probe by name.

        Parameters
        ----------
        name : str
            Its name.

        Returns
        -------
        ProbePort
            The probe.
        """
        return find_named("probe", name, self.probes)

    def body(self, name: str) -> BodyPort:
        """Return a body by name.

        Parameters
        ----------
        name : str
            Its name.

        Returns
        -------
        BodyPort
            The body.
        """
        return find_named("body", name, self.bodies)

    def load(self, name: str) -> LoadPort:
        """Return a load by name.

        Parameters
        ----------
        name : str
            Its name.

        Returns
        -------
        LoadPort
            The load.
        """
        return find_named("load", name, self.loads)

    def drive_springs(self, condition: DriveCondition) -> tuple[Array, Array]:
        """Return stiffness and constraints of the drives.

        Parameters
        ----------
        condition : str
            ``removed``, ``in place`` or ``locked``.

        Returns
        -------
        tuple of numpy.ndarray
            The stiffness of the drives, shape (n, n), and the vectors of those that are held at
            their length, one a column, shape (n, m). A rigid drive in place is held.

        Raises
        ------
        ModelError
            There is no such condition.
        """
        if condition not in ("removed", "in place", "locked"):
            raise ModelError(
                f"unknown drive condition '{condition}': expected removed, in place or locked"
            )
        added = np.zeros_like(self.K)
        constraints: list[Array] = []
        for d in self.drives:
            if condition == "removed" or d.stiffness == 0.0:
                continue
            if condition == "locked" or d.stiffness is None:
                constraints.append(d.vector)
            else:
                added += d.stiffness * np.outer(d.vector, d.vector)
        return added, np.array(constraints).reshape(len(constraints), self.order).T

    def mass_matrix(self, condition: DriveCondition) -> Array:
        r"""Return the mass matrix with the masses of the drives that are not removed.

        .. math:: M + \sum \frac{m}{6} (2 e_1^T e_1 + 2 e_2^T e_2 + e_1^T e_2 + e_2^T e_1)

        with the displacements e of both ends of a straight bar whose mass m is spread evenly.

        Parameters
        ----------
        condition : str
            ``removed``, ``in place`` or ``locked``.

        Returns
        -------
        numpy.ndarray
            The mass matrix, shape (n, n).
        """
        total = self.M
        for d in self.drives:
            if condition == "removed" or d.ends is None:
                continue
            first, second = d.ends
            both = first + second
            added = first.T @ first + second.T @ second + both.T @ both
            total = total + d.mass / 6.0 * added
        return total

    def base_force(self, direction: GroundDirection, condition: DriveCondition) -> Array:
        r"""Return the inertial force of an acceleration of the base.

        With coordinates relative to the base, :math:`q = q_{rel} + R r`,

        .. math:: M\ddot q_{rel} + C\dot q_{rel} + K q_{rel} = f - M R\ddot r

        In a translation, M R is the weight over the acceleration of gravity.

        Validity: hinges, drives and sensors stand on the base, which is rigid.

        Parameters
        ----------
        direction : str
            ``x``, ``y``, or ``rotation`` about the origin of the stage.
        condition : str
            Condition of the drives, whose masses take part unless they are removed.

        Returns
        -------
        numpy.ndarray
            M R e, the force against an acceleration of 1 m/s^2 or 1 rad/s^2, shape (n,).

        Raises
        ------
        ModelError
            The bodies bend, or drives with a mass are in place, in a rotation.
        """
        if direction == "rotation":
            force = self.M @ self._rotation()
        else:
            force = self.load(f"gravity {direction}").vector / STANDARD_GRAVITY
        for d in self.drives:
            if condition == "removed" or d.ends is None:
                continue
            if direction == "rotation":
                raise ModelError(
                    f"the rotation of the ground does not include the mass of drive '{d.name}': "
                    "leave out its mass, or the rotation"
                )
            # both ends of the bar accelerate with the base, also one that stands on it
            force = force + 0.5 * d.mass * d.ends[:, "xy".index(direction)].sum(axis=0)
        return force

    def _rotation(self) -> Array:
        """Return the coordinates of the undeformed stage that turns by 1 rad about its origin."""
        moving = [b for b in self.bodies if np.any(b.matrix)]  # a fixed body has no coordinates
        motion = np.concatenate([b.matrix for b in moving])
        turned = np.concatenate([(-b.centre[1], b.centre[0], 1.0) for b in moving])
        rotation = np.asarray(np.linalg.lstsq(motion, turned)[0], dtype=np.float64)
        complete = np.linalg.matrix_rank(motion) == self.order
        if not complete or np.abs(motion @ rotation - turned).max() > 1e-9:
            raise ModelError(
                f"the rotation of the ground needs rigid bodies, got the {self.model} model: "
                "choose the lumped one"
            )
        return rotation

    def with_damping(self, damping: Damping) -> "MechanicalSystem":
        """Return the same system with other damping.

        Parameters
        ----------
        damping : ModalDamping or RayleighDamping or LossFactor
            The damping.

        Returns
        -------
        MechanicalSystem
            The new system.
        """
        return replace(self, damping=damping)


def find_named(noun: str, name: str, among: Sequence[_T], where: str = ": the system has") -> _T:
    """Return the item of a name; `where` names in the message the owner of the others."""
    for one in among:
        if one.name == name:
            return one
    have = ", ".join(one.name for one in among) or "none"
    raise ModelError(f"there is no {noun} '{name}'{where} {have}")
