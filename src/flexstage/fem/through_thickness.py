"""Functions of the displacement of a plate through its thickness."""

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.polynomial.legendre import leggauss

from flexstage.base.arrays import Array

_POINTS = 16  # of each piece: exact for products of the functions of every piece
_THINNER = 0.25  # the second layer, in parts of the first
# Where the stress is looked for through half of the thickness, in parts of it, and below the faces
# of the plate, in depths of the layer there. The largest is where plane strain ends.
_INSIDE, _BELOW = (0.0, 0.5), (0.5, 0.25, 0.125, 0.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class DepthFunctions:
    """Functions through half of the thickness, orthonormal over all of it."""

    values: Array
    """Values at the points of integration, shape (k, q)."""
    slopes: Array
    """Derivatives there [1/m], shape (k, q)."""
    in_bodies: int
    """Number of the first ones that bodies have; the others are of notches alone."""
    transmitted: int
    """Number of the first ones with motions of their own at a neck."""


@dataclass(frozen=True, kw_only=True)
class ThroughThickness:
    r"""Functions of the displacement of a plate through its thickness.

    .. math:: u_i(x, y, z) = \sum_k u_{ik}(x, y)\,\varphi_{ik}(z)

    The motion of a plate is symmetric about its middle plane, which is motion in the plane, or
    antisymmetric, motion out of it. The functions are powers of z. In bodies they are 1 and z^2
    along the plane with z across for the first, with which a bar of any section bends exactly, and
    up to z^5 and z^4 for the other, as twisting a bar that is thicker than wide takes more than
    bending it. At the notches motion in the plane has more: one power higher each way, which lets a
    wide leaf bend to a saddle; and since a neck is in plane strain in the middle and in plane
    stress at the faces of the plate, and passes from one to the other within about two thicknesses
    of it, a linear and a quadratic function of that layer.

    A plane model has one function: the displacement along the plane is constant through the
    thickness and there is none across it, in plane stress, or in plane strain at selected notches.

    Raises
    ------
    ModelError
        The depth of the layer is not positive, or exceeds a quarter of the thickness.

    Notes
    -----
    B. A. Szabo, G. J. Sahrmann, Int. J. Numer. Meth. Eng. 26 (1988) 1855 (hierarchic plates).
    """

    thickness: float
    """Thickness of the plate [m]."""
    layer: float | None = None
    """Depth below its faces in which plane stress changes to plane strain [m]; None in a plane
    model.
    """
    out_of_plane: bool = False
    """True if the motion is that out of the plane."""
    fine: bool = False
    """True if a second layer, a quarter as deep, has functions too, for stress near the faces."""

    @property
    def in_space(self) -> bool:
        """True if the displacement changes through the thickness."""
        return self.layer is not None

    @property
    def _layers(self) -> tuple[float, ...]:
        """Depths of the layers [m]."""
        return () if self.layer is None else (self.layer, *((_THINNER * self.layer,) * self.fine))

    @property
    def levels(self) -> Array:
        """Levels at which stress is computed, from the middle plane on [m]."""
        if self.layer is None:
            return np.zeros(1)
        half = self.thickness / 2.0
        return np.concatenate((half * np.array(_INSIDE), half - self.layer * np.array(_BELOW)))

    @cached_property
    def rule(self) -> tuple[Array, Array]:
        """Points of integration of the upper half [m] and weights for the whole, shapes (q,)."""
        half = self.thickness / 2.0
        nodes = (0.0, *(half - layer for layer in self._layers), half)
        x, w = leggauss(_POINTS)
        z, weights = [], []
        for low, high in pairwise(nodes):
            z.append(low + (high - low) * (x + 1.0) / 2.0)
            weights.append((high - low) * w)
        return np.concatenate(z), np.concatenate(weights)

    def at(self, z: Array) -> dict[str, tuple[Array, Array]]:
        """Return the functions, not yet orthonormal, and their slopes at places z >= 0 [m].

        Those of the displacement along the plane are ``plane``, those across it ``across``.
        """
        s = z / (self.thickness / 2.0)

        def power(p: int) -> tuple[Array, Array]:
            return s**p, p * s ** max(p - 1, 0) if p else np.zeros_like(s)

        def outer(layer: float) -> list[tuple[Array, Array]]:
            edge = 1.0 - layer / (self.thickness / 2.0)
            beyond = np.where(s > edge, s - edge, 0.0)
            return [(beyond**p, p * beyond ** (p - 1) * (s > edge)) for p in (1, 2)]

        layers = [part for layer in self._layers for part in outer(layer)]
        if not self.in_space:
            plane, across = [power(0)], []
        elif self.out_of_plane:
            plane, across = [power(1), power(3), power(5)], [power(0), power(2), power(4)]
        else:
            plane = [power(0), power(2), power(4), *layers]
            across = [power(1), power(3), *layers]
        scale = 2.0 / self.thickness
        return {
            name: (
                np.array([v for v, _ in parts]).reshape(len(parts), z.size),
                scale * np.array([d for _, d in parts]).reshape(len(parts), z.size),
            )
            for name, parts in (("plane", plane), ("across", across))
        }

    @cached_property
    def functions(self) -> dict[str, DepthFunctions]:
        """Return the functions at the points of `rule`, orthonormal."""
        z, _ = self.rule
        return {
            name: DepthFunctions(
                values=mix @ values,
                slopes=mix @ slopes,
                in_bodies=min(3 if self.out_of_plane else 2 if name == "plane" else 1, len(values)),
                transmitted=min(2 if self.out_of_plane or name == "plane" else 1, len(values)),
            )
            for (name, (values, slopes)), mix in zip(
                self.at(z).items(), self._mixes.values(), strict=True
            )
        }

    @cached_property
    def _mixes(self) -> dict[str, Array]:
        z, weights = self.rule
        mixes = {}
        for name, (values, _) in self.at(z).items():
            lower = np.linalg.cholesky((values * weights) @ values.T)
            mixes[name] = np.asarray(np.linalg.inv(lower), dtype=float)
        return mixes

    def values_at(self, z: Array) -> dict[str, tuple[Array, Array]]:
        """Return the orthonormal functions and their slopes at places z >= 0 [m]."""
        return {
            name: (self._mixes[name] @ v, self._mixes[name] @ d)
            for name, (v, d) in self.at(z).items()
        }

    @cached_property
    def components(self) -> tuple[tuple[int, str, int], ...]:
        """Direction 0, 1, 2, kind and number of the function of every field in the plane."""
        return tuple(
            (direction, kind, k)
            for direction, kind in enumerate(("plane", "plane", "across"))
            for k in range(len(self.functions[kind].values))
        )
