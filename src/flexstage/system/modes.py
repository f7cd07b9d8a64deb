"""Natural modes, always with the condition of the drives that they belong to."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import LinAlgError, eigh, null_space

from flexstage.base.arrays import Array
from flexstage.base.errors import ModelError
from flexstage.base.short_repr import short_repr
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
    added, constraints = system.drive_springs(drives)
    total = system.K + added
    omega, shapes = generalized_modes(total, system.mass_matrix(drives), constraints, count)
    strain_energy = np.einsum("ik,ij,jk->k", shapes, system.K, shapes, optimize=True)
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.where(omega > 0.0, strain_energy / omega**2, 1.0)
        ratio = np.where(omega > 0.0, system.damping.ratios(omega, share), 0.0)
    return Modes(
        drives=drives,
        frequency_hz=omega / (2.0 * np.pi),
        shapes=shapes,
        damping_ratio=ratio,
    )


def generalized_modes(
    stiffness: Array, mass: Array, constraints: Array, count: int | None = None
) -> tuple[Array, Array]:
    """Solve K phi = omega^2 M phi, lowest first.

    K and M are symmetric, and each column v of `constraints` gives v^T phi = 0. Returns omega
    [rad/s], shape (k,), and shapes with phi^T M phi = 1, shape (n, k); all modes where `count` is
    None.
    """
    basis = null_space(constraints.T) if constraints.shape[1] else None
    if basis is not None:
        stiffness, mass = basis.T @ stiffness @ basis, basis.T @ mass @ basis
    n = stiffness.shape[0]
    last = n if count is None else min(count, n)
    if last == 0:
        return np.zeros(0), np.zeros((constraints.shape[0], 0))
    values, vectors = _softest_modes(stiffness, mass)
    omega = np.sqrt(np.clip(values[:last], 0.0, None))
    shapes = vectors[:, :last]
    return omega, shapes if basis is None else basis @ shapes


def _softest_modes(stiffness: Array, mass: Array) -> tuple[Array, Array]:
    """All eigenvalues of K against M and shapes, the lowest as exact as rounding lets them be.

    A solver errs by rounding of the largest eigenvalue that it finds: of M against K that is the
    softest mode, of K against M the stiffest, which may be 1e8 times as high. Only a stage that is
    held allows the first.
    """
    try:
        # the divide-and-conquer driver is the fast one, and a subset costs more than all of a few
        inverse, vectors = eigh(mass, stiffness, driver="gvd", check_finite=False)
        if inverse[0] > 0.0:
            values = 1.0 / inverse[::-1]
            return values, vectors[:, ::-1] * np.sqrt(values)
    except LinAlgError:
        pass  # a stage that can move without deforming anything
    try:
        return eigh(stiffness, mass, driver="gvd", check_finite=False)
    except LinAlgError as error:
        raise ModelError("a body has no mass, so the stage has no natural frequencies") from error
