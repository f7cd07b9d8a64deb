"""Stress at the critical points of hinges, linear in the coordinates of a system."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexstage.base.arrays import Array

_IN_PLANE = (0, 1, 2, 5)  # xx, yy, zz, xy


class StressByForces(NamedTuple):
    """Stress of places side by side by the forces that the coordinates put on them."""

    first: int
    """The first of the places."""
    stress: Array
    """Components xx, yy, zz, yz, xz, xy, or xx, yy, zz, xy, for unit forces, shape (k, c, e)."""
    forces: Array
    """Forces for the coordinates, shape (e, n)."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StressOfForces:
    """The matrix of a `StressMap` as a product, far smaller where few forces stress many places."""

    count: int
    """Number of places."""
    shares: tuple[StressByForces, ...]
    """Contributions to the stress; those of the same places add up."""

    def at(self, q: Array) -> Array:
        """Return the components for coordinates, shape (n,): shape (m, 6)."""
        components_at = np.zeros((self.count, 6))
        for share in self.shares:
            places, components, _ = share.stress.shape
            forces = share.forces @ q
            if not forces.any():  # a motion in the plane puts none on those out of it
                continue
            contribution = share.stress.reshape(-1, forces.size) @ forces
            contribution = contribution.reshape(places, components)
            where = components_at[share.first : share.first + places]
            if components == 6:
                where += contribution
            else:
                where[:, _IN_PLANE] += contribution
        return components_at

    def of(self, selected: NDArray[np.bool_]) -> "StressOfForces":
        """Return the same for some of the places."""
        before = np.concatenate(([0], np.cumsum(selected)))
        shares = []
        for first, stress, forces in self.shares:
            places_here = selected[first : first + len(stress)]
            if places_here.any():
                shares.append(StressByForces(int(before[first]), stress[places_here], forces))
        return StressOfForces(count=int(before[-1]), shares=tuple(shares))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StressMap:
    """Stress at the critical points of each hinge, linear in the coordinates."""

    hinges: tuple[str, ...]
    """Names of the hinges."""
    matrix: Array | StressOfForces
    """For each place and coordinate the signed equivalent stress [Pa], shape (m, n), or the
    components xx, yy, zz, yz, xz, xy of the stress [Pa], shape (m, 6, n), whose equivalent
    stress is that of von Mises.
    """
    owner: NDArray[np.intp]
    """Index into `hinges` of each place, shape (m,)."""
    point: NDArray[np.intp] | None = None
    """Number of the point that each place belongs to, shape (m,), some of which may be unused;
    several places, one in each finite element about it, share a point, and their stress is
    averaged there. None where each is a point of its own.
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
        np.maximum.at(worst, self.owner, self.equivalent(q))
        return dict(zip(self.hinges, worst.tolist(), strict=True))

    def of(self, hinge: str) -> "StressMap":
        """Return the map of one hinge."""
        of_hinge = self.owner == self.hinges.index(hinge)
        return StressMap(
            hinges=(hinge,),
            matrix=self.matrix.of(of_hinge)
            if isinstance(self.matrix, StressOfForces)
            else self.matrix[of_hinge],
            owner=np.zeros(np.count_nonzero(of_hinge), dtype=np.intp),
            point=None if self.point is None else self.point[of_hinge],
        )

    def scatter(self, q: Array) -> dict[str, float]:
        """Return the scatter of the elements about the most stressed point of each hinge.

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
        alone = np.abs(_equivalent(self.components(q)))
        high, low = np.full(self.point.max() + 1, -np.inf), np.full(self.point.max() + 1, np.inf)
        np.maximum.at(high, self.point, alone)
        np.minimum.at(low, self.point, alone)
        half = 0.5 * (high - low)
        for i in range(len(self.hinges)):
            at = np.flatnonzero(self.owner == i)
            if at.size:
                spread[i] = half[self.point[at[np.argmax(mean[at])]]]
        return dict(zip(self.hinges, spread.tolist(), strict=True))

    def components(self, q: Array) -> Array:
        """Return the product of `matrix` and coordinates, shape (n,): shape (m[, 6])."""
        return self.matrix.at(q) if isinstance(self.matrix, StressOfForces) else self.matrix @ q

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
        stress = self.components(q)
        if self.point is None or not self.point.size:
            return np.abs(_equivalent(stress))
        share = np.maximum(np.bincount(self.point), 1)
        columns = stress.reshape(self.point.size, -1).T
        total = [np.bincount(self.point, weights=column) / share for column in columns]
        averaged = np.stack(total, axis=-1).reshape(-1, *stress.shape[1:])
        return np.abs(_equivalent(averaged))[self.point]


def _equivalent(stress: Array) -> Array:
    """Return equivalent stresses: as they are, or by von Mises from six components."""
    if stress.ndim == 1:
        return stress
    xx, yy, zz, yz, xz, xy = stress.T
    normal = (xx - yy) ** 2 + (yy - zz) ** 2 + (zz - xx) ** 2
    return np.sqrt(0.5 * normal + 3.0 * (yz**2 + xz**2 + xy**2))
