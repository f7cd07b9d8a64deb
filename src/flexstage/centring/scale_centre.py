"""Where the centre of a scale is: a vector that turns with the table, with uncertainty."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from flexstage.arrays import Array
from flexstage.centring.first_order import Combined
from flexstage.centring.harmonic_fit import HarmonicFit
from flexstage.centring.vector_interval import direction_estimate, length_estimate
from flexstage.estimate import Component, Estimate


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Eccentricity:
    """Where the centre of a scale is, in the frame that turns with the table."""

    x: Estimate
    """Its coordinate x [m]."""
    y: Estimate
    """Its coordinate y [m]."""
    amplitude: Estimate
    """Its distance from the axis [m]."""
    phase: Estimate
    """Its direction, from x towards y [rad]."""
    covariance: Array
    """Of x and y [m^2], shape (2, 2)."""
    radius: float
    """Radius at which the scale is read [m]."""
    common: Estimate | None
    """Amplitude of the once-per-turn error that all heads share, as of the reference [rad]; None
    where the heads cannot tell it from eccentricity.
    """
    counter_motion: Estimate | None
    """Radius of the once-per-turn motion of the axis against the sense of turning [m]; None where
    the heads cannot tell.
    """
    fits: tuple[HarmonicFit, ...]
    """Of each head, less what exact geometry adds to the first order."""
    notes: tuple[str, ...]
    """What a reader should know."""

    @property
    def vector(self) -> Array:
        """Coordinates x and y [m], shape (2,)."""
        return np.array([self.x.value, self.y.value])

    def move(self, mount_angle: float = 0.0) -> Array:
        """Return the move of the stage that centres the scale: the eccentricity, back.

        Parameters
        ----------
        mount_angle : float
            Direction of the stage's own x axis in the frame that turns with the table [rad].

        Returns
        -------
        numpy.ndarray
            x and y along the axes of the stage [m], shape (2,).

        Examples
        --------
        >>> from flexstage.centring import HeadReadings, eccentricity, first_order_error
        >>> theta = np.arange(360) * np.pi / 180
        >>> error = first_order_error(theta, (30e-6, 0.0), 50e-3)
        >>> found = eccentricity([HeadReadings(angle=theta, error=error)], radius=50e-3)
        >>> print(f"{1e6 * found.move(np.pi / 2)[1]:.2f} um")
        30.00 um
        """
        c, s = math.cos(mount_angle), math.sin(mount_angle)
        return -np.array([[c, s], [-s, c]]) @ self.vector


def centre_from(
    found: Combined,
    fits: Sequence[HarmonicFit],
    radius: float,
    given: tuple[float, float, float],
    *,
    radial: bool = False,
) -> Eccentricity:
    """Return the eccentricity that once-per-turn harmonics stand for.

    It is read at `radius` [m]. `given` are standard uncertainties: of the scale's once-per-turn
    error [rad], or of the rim's [m], of the radius [m], and of the angle of the heads [rad].
    Harmonics of indicators are `radial`, displacements [m] and not angles.
    """
    graduation, own_radius, turned = given
    factor = 1.0 if radial else radius
    v = factor * found.vector
    noise = factor**2 * found.covariance
    grid = factor * graduation
    length = math.hypot(v[0], v[1])
    # the run-out of a rim is the eccentricity, whatever its radius
    scale = 0.0 if radial else own_radius / radius

    def with_others(plain: Estimate, along: float, across: float, own: float) -> Estimate:
        others = (
            Component(name="graduation", uncertainty=own, kind="B"),
            Component(name="radius", uncertainty=abs(along), kind="B"),
            Component(name="head angle", uncertainty=abs(across), kind="B"),
        )
        return plain.plus(*(c for c in others if c.uncertainty > 0.0))

    parts = []
    for i in (0, 1):
        own = Component(
            name="noise",
            uncertainty=math.sqrt(noise[i, i]),
            degrees_of_freedom=found.degrees_of_freedom,
        )
        plain = Estimate(value=float(v[i]), unit="m", components=(own,))
        parts.append(with_others(plain, scale * v[i], turned * v[1 - i], grid))
    freedom = found.degrees_of_freedom
    amplitude = length_estimate(v, noise, "m", degrees_of_freedom=freedom)
    phase = direction_estimate(v, noise, degrees_of_freedom=freedom)
    swing = min(math.pi, grid / length) if length > 0.0 else 0.0
    across = np.array([-v[1], v[0]])
    return Eccentricity(
        x=parts[0],
        y=parts[1],
        amplitude=with_others(amplitude, scale * length, 0.0, grid),
        phase=with_others(phase, 0.0, turned, swing),
        covariance=noise
        + (grid) ** 2 * np.eye(2)
        + scale**2 * np.outer(v, v)
        + turned**2 * np.outer(across, across),
        radius=radius,
        common=found.common,
        counter_motion=None
        if found.counter_motion is None
        else replace(found.counter_motion.times(factor), unit="m"),
        fits=tuple(fits),
        notes=_notes(found, graduation, len(fits), radial),
    )


def _notes(found: Combined, graduation: float, heads: int, radial: bool) -> tuple[str, ...]:
    notes = list(found.notes)
    if radial:
        if found.counter_motion is None:
            notes.append(
                "a once-per-turn motion of the axis counts as eccentricity, with "
                + ("one indicator" if heads == 1 else "indicators at these angles")
            )
        return tuple(notes)
    if graduation == 0.0:
        notes.append(
            "a once-per-turn error of the scale's own graduation counts as eccentricity: heads "
            "cannot tell them apart"
        )
    if found.common is None:
        also = "one head" if heads == 1 else "heads at these angles"
        notes.append(f"a once-per-turn error of the reference counts as eccentricity, with {also}")
    return tuple(notes)
