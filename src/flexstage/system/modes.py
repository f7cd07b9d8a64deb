"""Natural modes, always with the condition of the drives that they belong to."""

from dataclasses import dataclass, replace

import numpy as np

from flexstage.arrays import Array
from flexstage.short_repr import short_repr
from flexstage.system.linalg import generalized_modes
from flexstage.system.mechanical import DriveCondition, MechanicalSystem


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Modes:
    """Natural modes of a system."""

    drives: DriveCondition
    """Condition of the drives: ``removed``, ``in place`` or ``locked``."""
    frequency_hz: Array
    """Natural frequencies, lowest first [Hz], shape (k,)."""
    shapes: Array
    """Mode shapes with phi^T M phi = 1, one a column, shape (n, k)."""
    damping_ratio: Array
    """Damping ratio of each mode [1], shape (k,)."""
    uncertainty_hz: Array | None = None
    """Estimate of the error of each frequency [Hz], shape (k,), where one was asked for."""

    __repr__ = short_repr

    @property
    def omega(self) -> Array:
        """Angular natural frequencies [rad/s], shape (k,)."""
        return 2.0 * np.pi * self.frequency_hz

    def lowest(self, count: int) -> "Modes":
        """Return the lowest of these modes.

        Parameters
        ----------
        count : int
            How many; all where there are fewer.

        Returns
        -------
        Modes
            These modes.
        """
        return replace(
            self,
            frequency_hz=self.frequency_hz[:count],
            shapes=self.shapes[:, :count],
            damping_ratio=self.damping_ratio[:count],
            uncertainty_hz=None if self.uncertainty_hz is None else self.uncertainty_hz[:count],
        )


def modes(
    system: MechanicalSystem, *, drives: DriveCondition = "removed", count: int | None = 6
) -> Modes:
    """Return the natural modes of a system.

    Parameters
    ----------
    system : MechanicalSystem
        The system.
    drives : str
        ``removed`` (the bare stage), ``in place`` (with the stiffness of the drives; a rigid drive
        is held) or ``locked`` (all drives held at their length).
    count : int, optional
        Number of modes; all where None.

    Returns
    -------
    Modes
        The lowest modes.

    Raises
    ------
    ModelError
        A body has no mass.
    """
    added, held = system.drive_springs(drives)
    total = system.K + added
    omega, shapes = generalized_modes(total, system.M, held, count)
    own = np.einsum("ik,ij,jk->k", shapes, system.K, shapes, optimize=True)
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.where(omega > 0.0, own / omega**2, 1.0)
        ratio = np.where(omega > 0.0, system.damping.ratios(omega, share), 0.0)
    return Modes(
        drives=drives,
        frequency_hz=omega / (2.0 * np.pi),
        shapes=shapes,
        damping_ratio=ratio,
    )
