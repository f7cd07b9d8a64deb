"""One axis of a stage as two masses, springs and a lever, in numbers."""

from dataclasses import dataclass

import numpy as np

from flexstage.arrays import Array
from flexstage.errors import ModelError
from flexstage.system import MechanicalSystem, modes
from flexstage.system.mechanical import AxisPort

# A drive and a probe whose ratio differs by less from mode to mode move as one.
_AS_ONE = 1e-6


@dataclass(frozen=True, slots=True, kw_only=True)
class AxisChain:
    """An input mass and an output mass with a lever and a spring between them.

    With the elongation d of the drive and the reading p, the potential energy is
    ``(k_in d^2 + k_t (p - i d)^2)/2`` and the kinetic one ``(m_in d'^2 + m_out p'^2)/2``.
    """

    ratio: float
    """Static ratio i of reading to elongation of the drive [1]."""
    input_stiffness: float
    """Stiffness k_in that the drive feels [N/m], its own left out."""
    transmission_stiffness: float
    """Stiffness k_t of the transmission at its output [N/m]; 0 where the input and the output move
    as one.
    """
    input_mass: float
    """Mass m_in at the drive [kg]."""
    output_mass: float
    """Mass m_out at the probe [kg]; 0 where they move as one."""
    frequency_hz: float
    """Frequency of the mode that it holds, drives in place [Hz]."""


def axis_chain(system: MechanicalSystem, axis: AxisPort, *, pushed_mass: float) -> AxisChain:
    r"""Return two masses that stand for an axis of a stage, or one where no two positive ones do.

    `pushed_mass`, of the body that the drive pushes [kg], is the input mass where the displacement
    is imposed, which takes no part in the modes. All else follows in closed form from what is
    to be kept: the static elongation and reading for a unit of the drive, and of the mode that
    carries most of the reading its frequency :math:`\omega`, its shape :math:`(\phi_d, \phi_p)` and
    its modal mass 1,

    .. math:: k_t = \frac{\omega^2 - (k_{in} + k_s)\phi_d^2}{(\phi_p - i\phi_d)^2}, \quad
              m_{out} = \frac{k_t (\phi_p - i\phi_d)}{\omega^2\phi_p}, \quad
              m_{in} = \frac{1 - m_{out}\phi_p^2}{\phi_d^2}.

    Examples
    --------
    >>> from flexstage.designs import design
    >>> from flexstage.lumped import lumped_system
    >>> system = lumped_system(design("vgtu-piezo"))
    >>> chain = axis_chain(system, system.axes[0], pushed_mass=0.0143)
    >>> round(chain.ratio, 3), round(chain.frequency_hz, 1)
    (1.777, 910.3)
    """
    drive, probe = system.drive(axis.drive), system.probe(axis.probe).vector
    found = modes(system, drives="in place", count=None)
    own = drive.stiffness or 0.0
    elongation, reading, force = _statics(system, axis.drive, probe)
    if abs(reading) <= 1e-12 * abs(elongation):
        raise ModelError(f"drive '{axis.drive}' does not move probe '{axis.probe}'")
    ratio = reading / elongation
    stiffness = force / elongation
    phi_p = probe @ found.shapes
    if drive.stiffness is None:
        shape = _imposed_shape(system, axis.drive)
        share = phi_p * (found.shapes.T @ system.M @ shape)
        first = int(np.argmax(np.abs(share)))
        omega2 = float(found.omega[first] ** 2)
        at_p = float(phi_p[first])
        bare = modes(system, drives="removed", count=1)
        if abs(share[first]) < _AS_ONE * abs(reading):
            # the probe follows the imposed displacement at once
            return AxisChain(
                ratio=ratio,
                input_stiffness=stiffness,
                transmission_stiffness=0.0,
                input_mass=stiffness / float(bare.omega[0] ** 2),
                output_mass=0.0,
                frequency_hz=float(bare.omega[0] / (2.0 * np.pi)),
            )
        return AxisChain(
            ratio=ratio,
            input_stiffness=stiffness,
            transmission_stiffness=omega2 / at_p**2,
            input_mass=pushed_mass,
            output_mass=1.0 / at_p**2,
            frequency_hz=float(found.omega[first] / (2.0 * np.pi)),
        )
    phi_d = drive.vector @ found.shapes
    first = int(np.argmax(np.abs(phi_p * phi_d / found.omega**2)))
    omega2 = float(found.omega[first] ** 2)
    at_d, at_p = float(phi_d[first]), float(phi_p[first])
    swing = at_p - ratio * at_d
    frequency = float(found.omega[first] / (2.0 * np.pi))
    if abs(swing) > _AS_ONE * abs(at_p):
        k_t = (omega2 - (stiffness + own) * at_d**2) / swing**2
        m_out = k_t * swing / (omega2 * at_p)
        m_in = (1.0 - m_out * at_p**2) / at_d**2
        if k_t > 0.0 and m_out > 0.0 and m_in > 0.0:
            return AxisChain(
                ratio=ratio,
                input_stiffness=stiffness,
                transmission_stiffness=k_t,
                input_mass=m_in,
                output_mass=m_out,
                frequency_hz=frequency,
            )
    return AxisChain(
        ratio=ratio,
        input_stiffness=stiffness,
        transmission_stiffness=0.0,
        input_mass=(stiffness + own) / omega2,
        output_mass=0.0,
        frequency_hz=frequency,
    )


def _imposed_shape(system: MechanicalSystem, name: str) -> Array:
    """Static shape of a unit elongation of one drive, the others in place."""
    return _solved(system, name)[0]


def _statics(system: MechanicalSystem, name: str, probe: Array) -> tuple[float, float, float]:
    """Elongation of a drive, reading, and force on the stage without the drive's own spring."""
    shape, force = _solved(system, name)
    return 1.0, float(probe @ shape), force


def _solved(system: MechanicalSystem, name: str) -> tuple[Array, float]:
    """Shape for a unit elongation of one drive, the others in place, and the force it takes."""
    chosen = system.drive(name)
    added = np.zeros_like(system.K)
    columns = [chosen.vector]
    for d in system.drives:
        if d.name == name or d.stiffness == 0.0:
            continue
        if d.stiffness is None:
            columns.append(d.vector)
        else:
            added += d.stiffness * np.outer(d.vector, d.vector)
    held = np.stack(columns, axis=1)
    n, m = held.shape
    saddle = np.block([[system.K + added, held], [held.T, np.zeros((m, m))]])
    right = np.zeros(n + m)
    right[n] = 1.0
    # scaled, or lengths and angles spoil the solution
    size = np.concatenate((np.sqrt(np.diag(system.K + added)), np.ones(m)))
    solved = np.linalg.solve(saddle / np.outer(size, size), right / size) / size
    return solved[:n], -float(solved[n])
