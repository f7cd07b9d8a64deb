"""Leaf: a strip of constant thickness between sharp corners."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from flexstage.hinges.profile import Array, Length, Piece, Profile, Vertex


@dataclass(frozen=True, slots=True, kw_only=True)
class Leaf(Profile):
    """Strip of constant thickness that ends at sharp steps.

    Examples
    --------
    >>> leaf = Leaf(neck_thickness=0.5e-3, leaf_length=6e-3, notch_depth=1e-3)
    >>> leaf.root_height
    0.0025
    """

    kind: ClassVar[str] = "leaf"

    leaf_length: Length
    """Length of the strip [m]."""
    notch_depth: Length
    """Height of the step at its ends, on a side [m]."""

    @property
    def length(self) -> float:
        return self.leaf_length

    @property
    def depth(self) -> float:
        return self.notch_depth

    @property
    def neck_radius(self) -> float:
        return 0.0

    @property
    def flat_length(self) -> float:
        return self.leaf_length

    @property
    def step(self) -> float:
        return self.notch_depth

    def pieces(self) -> tuple[Piece, ...]:
        half = 0.5 * self.leaf_length

        def flat(u: Array) -> tuple[Array, Array, Array, Array]:
            zero = np.zeros_like(u)
            return half * u, zero, zero, np.full_like(u, half)

        return (flat,)

    def contour(self) -> tuple[Vertex, ...]:
        half = 0.5 * self.leaf_length
        return (Vertex(0.0, 0.0), Vertex(half, 0.0), Vertex(half, self.notch_depth))
