"""Deflection of a notch or leaf between its ends: slopes, shortening and bending of its shapes."""

from functools import lru_cache

import numpy as np
from scipy.integrate import cumulative_trapezoid

from flexstage.base.arrays import Array
from flexstage.hinges.profile import Profile

# a uniform column is right at once, one with fillets of a seventh of its length 5e-5 too strong
_WAVE_STEPS = 3


# a stage has dozens of hinges but a handful of profiles
@lru_cache(maxsize=1024)
def deflection_integrals(profile: Profile) -> tuple[Array, Array]:
    """Return integrals of the products of four slopes over a notch, and the bending of two.

    The slopes are those of a deformation v across, of one in rotation, of a full wave and of a sway
    between ends at rest, in the frame of the mean rotation of the ends; of the rotation,
    what two rigid ends have is taken off. A notch bends where it is thin: a shape is given by its
    moment, and that of the wave is its own deflection, as in a column that buckles. Shape (4, 4),
    and (2,): the integrals of h^3/12 s'^2.
    """
    x, depth, angle, ds = profile.samples()
    dx, half = np.cos(angle) * ds, 0.5 * profile.length
    h = profile.neck_thickness + profile.sides * depth
    flexibility = 1.0 / h**3

    def up_to(values: Array) -> Array:
        """Integral from the neck to each point."""
        return cumulative_trapezoid(np.r_[values[0], values], np.r_[0.0, x], initial=0.0)[1:]

    def across(moment: Array) -> tuple[Array, Array]:
        """Curvature and slope of a unit displacement of ends that stay parallel."""
        curvature = moment * flexibility
        size = 2.0 * np.sum(x * curvature * dx)
        return -curvature / size, (np.sum(curvature * dx) - up_to(curvature)) / size

    total = np.sum(flexibility * dx)
    turn = 0.5 * up_to(flexibility) / total
    shear_curvature, shear_slope = across(x)
    sway_curvature, sway_slope = across(np.sin(0.5 * np.pi * x / half))
    wave_slope, wave_curvature = np.sin(np.pi * x / half), np.zeros_like(x)
    for _ in range(_WAVE_STEPS):
        moment = -up_to(wave_slope)
        moment -= np.sum(moment * flexibility * dx) / total
        wave_curvature = moment / np.abs(moment).max() * flexibility / total
        wave_slope = up_to(wave_curvature)
    slopes = np.array([shear_slope, turn, wave_slope, sway_slope - shear_slope])
    # over both halves, the product of an even and an odd slope vanishes
    even = np.array([True, False, False, True])
    products = 2.0 * (slopes * dx) @ slopes.T * (even == even[:, None])
    products[1, 1] -= 0.25 * profile.length
    curved = np.array([wave_curvature, sway_curvature - shear_curvature])
    return products, 2.0 * np.sum(h**3 / 12.0 * curved**2 * dx, axis=1)
