"""A stage as a linear mechanical system, whatever model it comes from."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Literal, TypeVar

import numpy as np
from numpy.typing import NDArray

from flexstage.arrays import Array
from flexstage.errors import ModelError
from flexstage.short_repr import short_repr
from flexstage.stage.model import only_drive
from flexstage.system.damping import DEFAULT_DAMPING, Damping

#: What is done with the drives: taken out, left in with their stiffness, or held at their length.
DriveCondition = Literal["removed", "in place", "locked"]

#: Standard acceleration of gravity [m/s^2] (3rd CGPM, 1901).
STANDARD_GRAVITY = 9.80665

_T = TypeVar("_T", "DrivePort", "ProbePort", "BodyPort", "AxisPort", "LoadPort")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DrivePort:
    """Where a drive acts."""

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


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ProbePort:
    """Where motion is read."""

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


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LoadPort:
    """A load that acts on the whole stage, such as its weight or a change of temperature."""

    name: str
    """Name of the load."""
    vector: Array
    """Force on each coordinate for a load of one unit, shape (n,)."""
    unit: str
    """Unit of the load."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StressMap:
    """Stress at the critical points of each hinge, linear in the coordinates."""

    hinges: tuple[str, ...]
    """Names of the hinges."""
    matrix: Array
    """For each place and coordinate the signed equivalent stress [Pa], shape (m, n), or the
    components xx, yy, zz, yz, xz, xy of the stress [Pa], shape (m, 6, n), whose equivalent
    stress is that of von Mises.
    """
    owner: NDArray[np.intp]
    """Index into `hinges` of each place, shape (m,)."""
    point: NDArray[np.intp] | None = None
    """The point that each place belongs to, counted from 0, shape (m,); several places, one in each
    finite element about it, share a point, and their stress is averaged there. None where each
    is a point of its own.
    """

    def largest(self, q: Array) -> dict[str, float]:
        """Return the largest stress in each hinge.

        Parameters
        ----------
        q : numpy.ndarray
            Coordinates, shape (n,).

        Returns
        -------
        dict
            Largest magnitude of the equivalent stress by hinge [Pa].
        """
        worst = np.zeros(len(self.hinges))
        if self.owner.size:
            # places of one hinge side by side: far faster than one maximum at a time
            order = np.argsort(self.owner, kind="stable")
            owner = self.owner[order]
            first = np.flatnonzero(np.diff(owner, prepend=-1))
            worst[owner[first]] = np.maximum.reduceat(self.equivalent(q)[order], first)
        return dict(zip(self.hinges, worst.tolist(), strict=True))

    def of(self, hinge: str) -> "StressMap":
        """Return that of one hinge."""
        own = self.owner == self.hinges.index(hinge)
        return StressMap(
            hinges=(hinge,),
            matrix=self.matrix[own],
            owner=np.zeros(np.count_nonzero(own), dtype=np.intp),
            point=None
            if self.point is None
            else np.unique(self.point[own], return_inverse=True)[1].ravel(),
        )

    def scatter(self, q: Array) -> dict[str, float]:
        """Return by how much the elements about the most stressed point of each hinge differ.

        Parameters
        ----------
        q : numpy.ndarray
            Coordinates, shape (n,).

        Returns
        -------
        dict
            Half of the range of the equivalent stress there [Pa]; 0 where the stress comes from
            no mesh.
        """
        spread = np.zeros(len(self.hinges))
        if self.point is None or not self.owner.size:
            return dict(zip(self.hinges, spread.tolist(), strict=True))
        mean = self.equivalent(q)
        alone = np.abs(_equivalent(self.matrix @ q))
        high, low = np.full(self.point.max() + 1, -np.inf), np.full(self.point.max() + 1, np.inf)
        np.maximum.at(high, self.point, alone)
        np.minimum.at(low, self.point, alone)
        half = 0.5 * (high - low)
        for i in range(len(self.hinges)):
            at = np.flatnonzero(self.owner == i)
            if at.size:
                spread[i] = half[self.point[at[np.argmax(mean[at])]]]
        return dict(zip(self.hinges, spread.tolist(), strict=True))

    def equivalent(self, q: Array) -> Array:
        """Return the equivalent stress at each place, averaged at shared points.

        Parameters
        ----------
        q : numpy.ndarray
            Coordinates, shape (n,).

        Returns
        -------
        numpy.ndarray
            Its magnitude [Pa], shape (m,).
        """
        stress = self.matrix @ q
        if self.point is not None and self.point.size:
            share = np.bincount(self.point)
            columns = stress.reshape(self.point.size, -1).T
            total = [np.bincount(self.point, weights=column) / share for column in columns]
            stress = np.stack(total, axis=-1)[self.point].reshape(stress.shape)
        return np.abs(_equivalent(stress))


def _equivalent(stress: Array) -> Array:
    """Return equivalent stresses: as they are, or by von Mises from six components."""
    if stress.ndim == 1:
        return stress
    xx, yy, zz, yz, xz, xy = stress.T
    normal = (xx - yy) ** 2 + (yy - zz) ** 2 + (zz - xx) ** 2
    return np.sqrt(0.5 * normal + 3.0 * (yz**2 + xz**2 + xy**2))


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
    """Where drives act."""
    probes: tuple[ProbePort, ...] = ()
    """Where motion is read."""
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
    """Where the model stops being valid."""
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
        return _find("drive", name, self.drives)

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
        return _find("probe", name, self.probes)

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
        return _find("body", name, self.bodies)

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
        return _find("load", name, self.loads)

    def drive_springs(self, condition: DriveCondition) -> tuple[Array, Array]:
        """Return what the drives add to the bare stage.

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
        held: list[Array] = []
        for d in self.drives:
            if condition == "removed" or d.stiffness == 0.0:
                continue
            if condition == "locked" or d.stiffness is None:
                held.append(d.vector)
            else:
                added += d.stiffness * np.outer(d.vector, d.vector)
        return added, np.array(held).reshape(len(held), self.order).T

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


def _find(noun: str, name: str, ports: tuple[_T, ...]) -> _T:
    for port in ports:
        if port.name == name:
            return port
    raise ModelError(
        f"there is no {noun} '{name}': the system has {', '.join(p.name for p in ports) or 'none'}"
    )
