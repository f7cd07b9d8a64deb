"""Damping of a diagram, and the springs of its drives."""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import eigh
from scipy.optimize import nnls

from flexstage.arrays import Array
from flexstage.errors import ModelError
from flexstage.system import MechanicalSystem, RayleighDamping, modes

#: By how much a stiff spring in place of an imposed displacement may change the lowest frequencies.
_CHANGE = 1e-3
#: How many of them.
_WATCHED = 6
_STEPS = tuple(digit * 10.0**power for power in range(-2, 10) for digit in (1.0, 2.0, 5.0))


@dataclass(frozen=True, slots=True, kw_only=True)
class DriveSpring:
    """The spring between the free displacement of a drive and the stage."""

    stiffness: float
    """Its stiffness [N/m]; 0 for a drive that is a pure force."""
    stands_in: bool = False
    """Whether it takes the place of an imposed displacement."""
    own_frequency_hz: float = 0.0
    """About the frequency of the motion that one that stands in adds [Hz]. The drive follows its
    displacement with an error of (f/own)^2 at a frequency f.
    """


def drive_springs(system: MechanicalSystem) -> dict[str, DriveSpring]:
    """Return the spring of each drive; one that stands in where the displacement is imposed.

    That is just stiff enough that the six lowest frequencies with the drives in place change by
    less than 0.1 %.

    Examples
    --------
    >>> from flexstage.designs import design
    >>> from flexstage.lumped import lumped_system
    >>> drive_springs(lumped_system(design("parallelogram")))["x"].stands_in
    True
    """
    known = {
        d.name: DriveSpring(stiffness=float(d.stiffness))
        for d in system.drives
        if d.stiffness is not None
    }
    rigid = [d for d in system.drives if d.stiffness is None]
    if not rigid:
        return known
    watched = modes(system, drives="in place", count=min(_WATCHED, system.order - len(rigid)))
    added = system.drive_springs("in place")[0]
    local = np.array([float(d.vector @ system.K @ d.vector) for d in rigid])
    local = 10.0 ** np.ceil(np.log10(local))
    for step in _STEPS:
        stiffness = local * step
        total = system.K + added
        for k, d in zip(stiffness, rigid, strict=True):
            total = total + k * np.outer(d.vector, d.vector)
        found = eigh(
            total, system.M, eigvals_only=True, subset_by_index=(0, watched.omega.size - 1)
        )
        change = np.abs(np.sqrt(np.maximum(found, 0.0)) / watched.omega - 1.0)
        if np.all(change < _CHANGE):
            stand_in = {
                d.name: DriveSpring(
                    stiffness=float(k),
                    stands_in=True,
                    own_frequency_hz=_own_frequency(system, d.vector, float(k)),
                )
                for k, d in zip(stiffness, rigid, strict=True)
            }
            return {d.name: (known | stand_in)[d.name] for d in system.drives}
    raise ModelError(
        f"no spring is stiff enough to stand in for the rigid drives of '{system.name}': give the "
        "drives a stiffness"
    )


def _own_frequency(system: MechanicalSystem, vector: Array, stiffness: float) -> float:
    """Frequency of the pushed bodies alone on a spring [Hz]."""
    mobility = float(vector @ np.linalg.solve(system.M, vector))
    return float(np.sqrt(stiffness * mobility) / (2.0 * np.pi))


def fitted_damping(system: MechanicalSystem) -> RayleighDamping:
    """Return Rayleigh damping that gives the two lowest modes, drives in place, what they have.

    Where alpha and beta cannot both be positive, the closest that can.

    Examples
    --------
    >>> from flexstage.designs import design
    >>> from flexstage.lumped import lumped_system
    >>> found = fitted_damping(lumped_system(design("vgtu-piezo")))
    >>> round(found.alpha, 2), round(found.beta * 1e6, 3)
    (81.84, 0.995)
    """
    if isinstance(system.damping, RayleighDamping):
        return system.damping
    found = modes(system, drives="in place", count=min(2, system.order))
    if not np.all(found.omega > 0.0):
        raise ModelError(
            f"stage '{system.name}' has a motion without stiffness: constrain it before it is drawn"
        )
    ratios = np.asarray(found.damping_ratio, dtype=np.float64)
    rows = 0.5 * np.stack((1.0 / found.omega, found.omega), axis=1)
    # columns of like size, or the smaller factor drowns
    size = np.linalg.norm(rows, axis=0)
    alpha, beta = (nnls(rows / size, ratios)[0] / size).tolist()
    return RayleighDamping(alpha=alpha, beta=beta)
