"""A notch as a spring in its plane: its compliance about the neck and its plane state.

Local axes: 1 along the hinge from body a to body b, 2 to the left of it, rotation to the left. The
matrix maps the force (N, V, M) on body b at the neck to the motion of b against a there.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from flexstage.base.arrays import Array

PlaneState = Literal["stress", "strain"]

# A notch that is this many necks wide cannot contract along its width: the thick roots hold it.
# Reference piece, width/neck = 20: plane strain is 1.6 % too stiff, plane stress 10.4 % too soft.
WIDE_NECK = 5.0
#: The rule of `plane_state` in words, for notes on validity.
PLANE_RULE = f"plane strain for widths of at least {WIDE_NECK:g} neck thicknesses"

# How far into the adjoining bodies the root reaches, in heights of the root; beyond it
# bodies count as rigid. It is one number found from the finite-element figures of two stages of 32
# hinges each (stroke, stress, two frequencies, in plane stress and in plane strain: 24 figures, all
# within 0.9 %).
ROOT_REACH = 1.2

# Part of what plane strain adds to the stiffness in bending that a leaf has whose ends hold its
# width, by width over length: elements in space of a guided leaf 50 times as long as thick,
# Poisson's ratio 0.3. Of one 10 to 20 times as long it is lower by a tenth to a fifth.
_HELD_BY_ENDS = (0.05, 0.1, 0.2, 0.4, 0.8, 1.5), (0.075, 0.174, 0.360, 0.613, 0.816, 0.917)


@dataclass(frozen=True, slots=True, kw_only=True)
class HingeCompliance:
    """A notch as a spring with two translations and one rotation."""

    matrix: Array
    """Compliance about the neck, rows (u, v, theta), columns (N, V, M) [m/N, m/(N m), rad/N, rad/(N
    m)], shape (3, 3).
    """
    method: str
    """Method by which it was found."""
    plane: PlaneState
    """``stress`` or ``strain``: whether the notch can contract along its width."""

    @property
    def stiffness(self) -> Array:
        """Stiffness about the neck, the inverse of `matrix`, shape (3, 3)."""
        inverse = np.linalg.inv(self.matrix)
        return 0.5 * (inverse + inverse.T)


def plane_state(
    width: float, neck_thickness: float, plane: PlaneState | Literal["auto"] = "auto"
) -> PlaneState:
    """Choose plane strain or plane stress for a notch, by its width against its neck.

    Parameters
    ----------
    width : float
        Width of the hinge, the thickness of the plate [m].
    neck_thickness : float
        Thickness of the neck [m].
    plane : str
        ``stress``, ``strain``, or ``auto`` to choose.

    Returns
    -------
    str
        With ``auto``, ``strain`` from five necks of width on, ``stress`` below.

    Examples
    --------
    >>> plane_state(10e-3, 0.5e-3)
    'strain'
    """
    if plane != "auto":
        return plane
    return "strain" if width >= WIDE_NECK * neck_thickness else "stress"


def plane_moduli(modulus: float, poisson: float, plane: PlaneState) -> tuple[float, float]:
    """Return the modulus and Poisson's ratio of a plane problem."""
    if plane == "stress":
        return modulus, poisson
    return modulus / (1.0 - poisson**2), poisson / (1.0 - poisson)


def held_leaf_stiffening(width: float, length: float, poisson: float) -> float:
    r"""Return the bending stiffness of a leaf between rigid bodies over that in plane stress.

    Its ends hold its width, its middle contracts as it likes: it lies between 1 and plane strain,
    :math:`1/(1-\nu^2)`.

    Notes
    -----
    Validity: width 0.05 to 1.5 of the length, beyond which the nearest is taken; within 1 %.

    Examples
    --------
    >>> round(held_leaf_stiffening(50e-3, 250e-3, 0.3), 4)
    1.0356
    """
    part = float(np.interp(np.log(width / length), np.log(_HELD_BY_ENDS[0]), _HELD_BY_ENDS[1]))
    return 1.0 + part * (1.0 / (1.0 - poisson**2) - 1.0)


def strip_compliance(
    ends: tuple[float, float], width: float, middle: float, poisson: float, side: float = 1.0
) -> Array:
    """Return the compliance about a neck of a strip of a body, as a beam with shear.

    It lies between two distances from the neck, with its middle at a distance to the left of the
    hinge's line; `side` is 1 in body b, -1 in body a. Times E b, shape (3, 3).
    """
    start, end = ends
    # integrals of 1, x and x^2
    i0, i1, i2 = end - start, (end**2 - start**2) / 2.0, (end**3 - start**3) / 3.0
    c = np.empty((3, 3))
    c[0, 0] = i0 / width + 12.0 * middle**2 * i0 / width**3
    c[1, 1] = 12.0 * i2 / width**3 + 2.4 * (1.0 + poisson) * i0 / width
    c[2, 2] = 12.0 * i0 / width**3
    c[0, 2] = c[2, 0] = 12.0 * middle * i0 / width**3
    c[1, 2] = c[2, 1] = -side * 12.0 * i1 / width**3
    c[0, 1] = c[1, 0] = -side * 12.0 * middle * i1 / width**3
    return c
