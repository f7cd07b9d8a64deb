"""Damping of a mechanical system; every kind here leaves the undamped mode shapes as they are."""

from dataclasses import dataclass

import numpy as np

from flexstage.arrays import Array
from flexstage.errors import ModelError
from flexstage.stage.assumptions import DAMPING_RATIO


@dataclass(frozen=True, slots=True, kw_only=True)
class ModalDamping:
    """The same damping ratio for every mode."""

    ratio: float
    """Damping ratio zeta [1]."""

    def __post_init__(self) -> None:
        if not 0.0 <= self.ratio < 1.0:
            raise ModelError(f"a damping ratio lies from 0 to below 1, got {self.ratio!r}")

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
        del hinge_share
        return np.full_like(omega, self.ratio)


#: Assumed where nothing was measured.
DEFAULT_DAMPING = ModalDamping(ratio=DAMPING_RATIO)


@dataclass(frozen=True, slots=True, kw_only=True)
class RayleighDamping:
    """Viscous damping C = alpha M + beta K (Lord Rayleigh, The Theory of Sound, 1877, art. 97).

    K is that of the stage with the springs of the drives that are in place.
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
            (alpha/omega + beta omega)/2 [1], shape (k,).
        """
        del hinge_share
        return 0.5 * (self.alpha / omega + self.beta * omega)


@dataclass(frozen=True, slots=True, kw_only=True)
class LossFactor:
    """Material damping of the hinges, as viscous damping that is right at each resonance."""

    eta: float
    """Loss factor of the hinge material [1]: energy lost in a cycle over 2 pi times the largest
    strain energy.
    """

    def __post_init__(self) -> None:
        if not 0.0 <= self.eta < 2.0:
            raise ModelError(f"a loss factor lies from 0 to below 2, got {self.eta!r}")

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
            eta/2 times the share [1], shape (k,).
        """
        del omega
        return 0.5 * self.eta * hinge_share


Damping = ModalDamping | RayleighDamping | LossFactor
