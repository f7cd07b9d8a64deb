"""What a stage does at rest under a drive that imposes its displacement."""

import numpy as np

from flexstage.arrays import Array
from flexstage.system.mechanical import DrivePort, MechanicalSystem


def imposed_shape(system: MechanicalSystem, drive: DrivePort) -> Array:
    """Return the shape at rest for one metre of a rigid drive in place.

    The other rigid drives keep their length. Shape (n,), in the coordinates' units over m.
    """
    added, vectors = system.drive_springs("in place")
    n, m = vectors.shape
    saddle = np.block([[system.K + added, vectors], [vectors.T, np.zeros((m, m))]])
    right = np.zeros(n + m)
    right[n + int(np.argmax([np.array_equal(v, drive.vector) for v in vectors.T]))] = 1.0
    return np.asarray(np.linalg.solve(saddle, right)[:n], dtype=np.float64)
