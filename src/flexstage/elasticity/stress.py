"""Invariants of the stress."""

import ngsolve as ng
import numpy as np
from numpy.typing import NDArray

#: Order of the six components of a stress.
COMPONENTS: tuple[tuple[int, int], ...] = ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))


def von_mises(stress: ng.CoefficientFunction) -> ng.CoefficientFunction:
    """Return the equivalent stress of von Mises of a stress on a mesh [Pa].

    Parameters
    ----------
    stress : ngsolve.CoefficientFunction
        The tensor, 3 x 3 [Pa].

    Returns
    -------
    ngsolve.CoefficientFunction
        The equivalent stress.
    """
    s = stress
    normal = (s[0, 0] - s[1, 1]) ** 2 + (s[1, 1] - s[2, 2]) ** 2 + (s[2, 2] - s[0, 0]) ** 2
    shear = s[0, 1] ** 2 + s[1, 2] ** 2 + s[0, 2] ** 2
    return ng.sqrt(0.5 * normal + 3.0 * shear)


def von_mises_of(components: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the equivalent stress of von Mises of stress components [Pa].

    xx, yy, zz, yz, xz, xy are the last axis [Pa], shape (..., 6).
    """
    xx, yy, zz, yz, xz, xy = np.moveaxis(components, -1, 0)
    normal = (xx - yy) ** 2 + (yy - zz) ** 2 + (zz - xx) ** 2
    return np.sqrt(0.5 * normal + 3.0 * (yz**2 + xz**2 + xy**2))
