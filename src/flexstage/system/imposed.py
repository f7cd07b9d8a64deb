"""What a stage does at rest under a drive that imposes its displacement."""

import numpy as np
from numpy.typing import NDArray

from flexstage.system.mechanical import DrivePort, MechanicalSystem

__all__ = ["imposed_shape"]

Array = NDArray[np.float64]


def imposed_shape(system: MechanicalSystem, drive: DrivePort) -> Array:
    """Return the shape at rest for one metre of a rigid drive in place.

    Parameters
    ----------
    system : MechanicalSystem
        The system.
    drive : DrivePort
        One of its drives that is rigid; the other rigid ones keep their length.

    Returns
    -------
    numpy.ndarray
        Coordinates over the displacement [1/m times their unit], shape (n,).
    """
    added, vectors = system.drive_springs("in place")
    n, m = vectors.shape
    saddle = np.block([[system.K + added, vectors], [vectors.T, np.zeros((m, m))]])
    right = np.zeros(n + m)
    right[n + int(np.argmax([np.array_equal(v, drive.vector) for v in vectors.T]))] = 1.0
    return np.asarray(np.linalg.solve(saddle, right)[:n], dtype=np.float64)
