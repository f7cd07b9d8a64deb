"""Leaf: a strip of constant thickness between sharp corners."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from flexstage.hinges.profile import Array, Length, Piece, Profile, Vertex

__all__ = ["Leaf"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Leaf(Profile):
    """Strip of constant thickness that ends at sharp steps.

    Parameters
    ----------
    neck_thickness : float
        Thickness t of the strip [m].
    one_sided : bool
        Whether the strip is cut free on one side only, the other side being straight.
    leaf_length : float
        Length of the strip [m].
    notch_depth : float
        Height of the step at its ends, on a side [m].

    Examples
    --------
    >>> leaf = Leaf(neck_thickness=0.5e-3, leaf_length=6e-3, notch_depth=1e-3)
    >>> leaf.root_height
    0.0025
    """

    kind: ClassVar[str] = "leaf"

    leaf_length: Length
    notch_depth: Length

    @property
    def length(self) -> float:
        """Length of the whole notch along the hinge [m]."""
        return self.leaf_length

    @property
    def depth(self) -> float:
        """Depth of the notch at its root, on one side [m]."""
        return self.notch_depth

    @property
    def neck_radius(self) -> float:
        """Radius of the corner, where the stress is largest: none [m]."""
        return 0.0

    @property
    def flat_length(self) -> float:
        """Length of the part of constant thickness [m]."""
        return self.leaf_length

    @property
    def step(self) -> float:
        """Height of the sharp step at the root, on one side [m]."""
        return self.notch_depth

    def pieces(self) -> tuple[Piece, ...]:
        """Return the flat half; the step at its end is no part of it."""
        half = 0.5 * self.leaf_length

        def flat(u: Array) -> tuple[Array, Array, Array, Array]:
            zero = np.zeros_like(u)
            return half * u, zero, zero, np.full_like(u, half)

        return (flat,)

    def contour(self) -> tuple[Vertex, ...]:
        """Return the flat half and the step."""
        half = 0.5 * self.leaf_length
        return (Vertex(0.0, 0.0), Vertex(half, 0.0), Vertex(half, self.notch_depth))
