"""Motion in time of a stage whose drives stand on seats, and lift off."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import expm

from flexstage.base.arrays import Array
from flexstage.base.errors import ModelError
from flexstage.base.short_repr import short_repr
from flexstage.stage.model import Stage
from flexstage.system.mechanical import MechanicalSystem
from flexstage.system.modes import modes
from flexstage.system.seated_drives import contact_forces, seated_drives, static_drives

# Steps in a period of the highest of the modes, drives in place, that are resolved in time.
_STEPS, _RESOLVED = 60, 8


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SeatedResponse:
    """Motion in time with drives on their seats."""

    time: Array
    """Times [s], shape (n,)."""
    readings: Mapping[str, Array]
    """Reading of each probe [m, or rad], shape (n,)."""
    contact_force: Mapping[str, Array]
    """Pressing force on the seats of each drive [N], shape (n,); of a drive that only presses 0
    where it has lifted off.
    """
    presses: frozenset[str]
    """Drives that only press."""

    __repr__ = short_repr

    def lifted(self, drive: str) -> bool:
        """Return whether a seat of a drive lifts off."""
        return drive in self.presses and bool(np.any(self.contact_force[drive] <= 0.0))


def seated_response(
    stage: Stage,
    system: MechanicalSystem,
    time: ArrayLike,
    displacements: Mapping[str, ArrayLike],
) -> SeatedResponse:
    r"""Return the motion of a stage under free displacements of its drives on their seats.

    .. math:: \ddot z + 2\zeta\omega\dot z + \omega^2 z = \Phi^T\sum_i d_i F_i, \quad
              d_i^T\Phi z + c_i(F_i) = w_i(t), \quad F_{0i} + F_i \ge 0

    The modes are those of the stage without drives, and c is the compression of drive and seats.
    Between steps forces move on straight lines; the last one of a step fulfils the law at its end.

    Parameters
    ----------
    stage : Stage
        The stage.
    system : MechanicalSystem
        A model of it.
    time : array_like
        Times in equal steps [s], shape (n,); steps within are as fine as the modes need.
    displacements : Mapping
        Free displacement by drive [m], shape (n,); lines between samples. Of every other drive 0.

    Returns
    -------
    SeatedResponse
        The motion, from rest at the first displacements.

    Raises
    ------
    ModelError
        Times do not rise, shapes differ, a drive does not exist, or the stage is a mechanism.

    Notes
    -----
    Validity: as `static_drives`; masses of the drives are omitted, and damping is that of the bare
    stage: an impact in the seat itself loses no energy.
    """
    t = np.asarray(time, dtype=np.float64)
    inputs = {name: np.asarray(w, dtype=np.float64) for name, w in displacements.items()}
    if t.ndim != 1 or t.size < 2 or not t[1] > t[0]:
        raise ModelError(f"times must rise, and be at least two, got shape {t.shape}")
    if not np.allclose(np.diff(t), t[1] - t[0], rtol=1e-6, atol=0.0):
        raise ModelError("times must rise by equal steps")
    for name, w in inputs.items():
        if w.shape != t.shape:
            raise ModelError(
                f"the displacement of '{name}' must have shape {t.shape}, got {w.shape}"
            )
    start = static_drives(stage, system, {name: float(w[0]) for name, w in inputs.items()})
    drives, vectors, K = seated_drives(stage, system)
    sprung = replace(system, K=K)  # a preload spring belongs to what the drives push on
    bare = modes(sprung, drives="removed", count=None)
    shapes, omega = bare.shapes, bare.omega
    push, damping = shapes.T @ vectors, 2.0 * bare.damping_ratio * omega
    together = modes(system, drives="in place", count=_RESOLVED).frequency_hz[-1]
    parts = math.ceil(float(t[1] - t[0]) * _STEPS * together)
    fine = np.linspace(t[0], t[-1], (t.size - 1) * parts + 1)
    w = np.array([np.interp(fine, t, inputs.get(d.name, np.zeros_like(t))) for d in drives]).T
    # exact for forces on straight lines between steps; a column for z, v, the force and its change
    h = float(fine[1] - fine[0])
    growth = np.zeros((omega.size, 4, 4))
    growth[:, 0, 1], growth[:, 1, 2] = h, h
    growth[:, 1, 0], growth[:, 1, 1], growth[:, 2, 3] = -h * omega**2, -h * damping, 1.0
    z_of, v_of = expm(growth)[:, :2].transpose(1, 2, 0)
    compliance = push.T @ (z_of[3][:, None] * push)

    z = shapes.T @ (system.M @ start.static.q)
    v = np.zeros_like(z)
    force = np.array([start.drives[d.name].force for d in drives])
    q, pressing = np.zeros((t.size, system.order)), np.zeros((t.size, len(drives)))
    for i in range(fine.size):
        if i:
            at_start = push @ force
            coast = z_of[0] * z + z_of[1] * v + (z_of[2] - z_of[3]) * at_start
            force = contact_forces(drives, compliance, w[i] - push.T @ coast)
            at_end = push @ force
            v = v_of[0] * z + v_of[1] * v + (v_of[2] - v_of[3]) * at_start + v_of[3] * at_end
            z = coast + z_of[3] * at_end
        if i % parts == 0:
            q[i // parts], pressing[i // parts] = shapes @ z, force
    preload = [d.preload.force if d.preload else 0.0 for d in drives]
    return SeatedResponse(
        time=t,
        presses=frozenset(d.name for d in drives if not d.pulls),
        readings={p.name: q @ p.vector for p in system.probes},
        contact_force={
            d.name: f + f0 for d, f, f0 in zip(drives, pressing.T, preload, strict=True)
        },
    )
