"""One axis of a stage as masses, springs, dampers and a lever: parameters and diagram."""

from dataclasses import dataclass

import numpy as np

from flexstage.base.arrays import Array
from flexstage.base.errors import ModelError
from flexstage.export.diagram.blocks import (
    BodyBlocks,
    DriveSpring,
    add_drive_chain,
    add_probe_chain,
)
from flexstage.export.diagram.graph import Diagram, DiagramBuilder, GroupBuilder
from flexstage.hysteresis.dynamic_model import DynamicModel, ModelDrive, ModelProbe
from flexstage.system import MechanicalSystem, RayleighDamping, modes
from flexstage.system.mechanical import AxisPort

# Largest relative difference of the ratio of drive and probe between modes for one mass.
_ONE_MASS = 1e-6


@dataclass(frozen=True, slots=True, kw_only=True)
class AxisChain:
    """An input mass and an output mass, joined by a lever and a spring.

    With the elongation d of the drive and the reading p, the potential energy is
    ``(k_in d^2 + k_t (p - i d)^2)/2`` and the kinetic one ``(m_in d'^2 + m_out p'^2)/2``.
    """

    ratio: float
    """Static ratio i of reading over elongation of the drive [1]."""
    input_stiffness: float
    """Input stiffness k_in of the stage at the drive [N/m], without that of the drive."""
    transmission_stiffness: float
    """Stiffness k_t of the transmission at its output [N/m]; 0 for one mass."""
    input_mass: float
    """Mass m_in at the drive [kg]."""
    output_mass: float
    """Mass m_out at the probe [kg]; 0 for one mass."""
    frequency_hz: float
    """Frequency of its mode, drives in place [Hz]."""


def axis_blocks(
    model: DynamicModel,
    drive: ModelDrive,
    probe: ModelProbe,
    chain: AxisChain,
    *,
    spring: DriveSpring,
    damping: RayleighDamping,
    title: str,
    notes: tuple[str, ...],
) -> Diagram:
    """Return the diagram of an axis."""
    b = DiagramBuilder()
    group = b.group("drive", title=f"Drive {drive.name} ({drive.kind})", kind="drive")
    free = add_drive_chain(b, model, drive, group)
    two_masses = chain.output_mass > 0.0
    head = _mass(
        b,
        "input",
        "Input" if two_masses else "Stage",
        "d",
        chain.input_mass,
        damping.alpha * chain.input_mass + damping.beta * chain.input_stiffness,
        chain.input_stiffness,
    )
    force = free
    if spring.stiffness > 0.0:
        force = _drive_spring(b, drive, spring, damping, free, head, group)
    b.term(head.forces, force, 1, "F [N]")
    read = _transmission(b, chain, damping, head).motion if two_masses else head.motion
    probe_group = b.group("probe", title=f"Probe {probe.name}", kind="probe")
    if not two_masses:
        meaning = f"ratio of reading to drive {drive.name} [1]"
        lever = probe_group.gain("ratio", "i", meaning, chain.ratio, "geometry")
        b.connect(read, lever, "d [m]")
        read = lever
    add_probe_chain(b, probe, read, probe_group, "p [m]" if two_masses else "")
    return b.diagram(title, notes)


def _mass(
    b: DiagramBuilder,
    name: str,
    title: str,
    letter: str,
    mass: float,
    damper: float,
    stiffness: float,
) -> BodyBlocks:
    """Add a mass, with a spring and a damper to the ground."""
    low = title.lower()
    # a single mass needs no subscript
    short = {"Input": "_in", "Output": "_out"}.get(title, "")
    group = b.group(name, title=f"{title} mass", kind="body")
    forces = group.sum("forces", f"forces on the {low} [N]")
    meaning = f"inverse mass of the {low} [1/kg]"
    inverse = group.gain("inverse_mass", f"1/m{short}", meaning, 1.0 / mass, "mass")
    rate = group.integrator("rate", f"speed of the {low} {letter}' [m/s]")
    motion = group.integrator("motion", f"motion of the {low} {letter} [m]")
    b.chain(forces, inverse, rate, motion)
    if stiffness > 0.0:
        meaning = f"spring between the {low} and the ground [N/m]"
        ground_spring = group.gain("spring", f"k{short}", meaning, stiffness, "spring")
        b.connect(motion, ground_spring)
        b.term(forces, ground_spring, -1, last=True)
    # after the spring: its line is inside that of the spring
    if damper > 0.0:
        meaning = f"damper between the {low} and the ground [N s/m]"
        ground_damper = group.gain("damper", f"c{short}", meaning, damper, "damper")
        b.connect(rate, ground_damper)
        b.term(forces, ground_damper, -1, last=True)
    return BodyBlocks(forces=forces, rate=rate, motion=motion, name=name)


def _drive_spring(
    b: DiagramBuilder,
    drive: ModelDrive,
    spring: DriveSpring,
    damping: RayleighDamping,
    free: str,
    head: BodyBlocks,
    group: GroupBuilder,
) -> str:
    """Add the spring of a drive between its free displacement and the input; return its force."""
    stretch = group.sum("compression", f"compression of drive {drive.name} [m]")
    b.term(stretch, free, 1, f"w_{drive.name} [m]")
    b.term(stretch, head.motion, -1, "d [m]")
    words = (
        "stiff spring in place of an imposed displacement"
        if spring.replaces_imposed
        else "stiffness"
    )
    meaning = f"{words} of drive {drive.name} [N/m]"
    stiffness = group.gain("spring", "k_s", meaning, spring.stiffness, "spring")
    b.connect(stretch, stiffness)
    if spring.replaces_imposed or damping.beta == 0.0:
        return stiffness
    meaning = f"damping of drive {drive.name} [N s/m]"
    damper = group.gain("damper", "c_s", meaning, damping.beta * spring.stiffness, "damper")
    b.connect(head.rate, damper, "d' [m/s]")
    force = group.sum("force", f"force of drive {drive.name} [N]")
    b.term(force, stiffness, 1)
    b.term(force, damper, -1)
    return force


def _transmission(
    b: DiagramBuilder, chain: AxisChain, damping: RayleighDamping, head: BodyBlocks
) -> BodyBlocks:
    """Add lever, spring and damper between the input and the output, and the output mass."""
    group = b.group("transmission", title="Transmission: lever and spring", kind="hinge")
    tail = _mass(
        b, "output", "Output", "p", chain.output_mass, damping.alpha * chain.output_mass, 0.0
    )
    stretch = group.sum("deformation", "deformation of the transmission i d - p [m]")
    words = "ratio of the lever [1]"
    lever = group.gain("motion_ratio", "i", words, chain.ratio, "geometry")
    b.connect(head.motion, lever, "d [m]")
    b.term(stretch, lever, 1)
    b.term(stretch, tail.motion, -1, "p [m]")
    stiffness = chain.transmission_stiffness
    meaning = "stiffness of the transmission [N/m]"
    force = spring = group.gain("spring", "k_t", meaning, stiffness, "spring")
    b.connect(stretch, spring)
    if damping.beta > 0.0:
        rate = group.sum("rate", "rate of deformation i d' - p' [m/s]")
        speed = group.gain("rate_ratio", "i", words, chain.ratio, "geometry")
        b.connect(head.rate, speed, "d' [m/s]")
        b.term(rate, speed, 1)
        b.term(rate, tail.rate, -1, "p' [m/s]")
        meaning = "damping of the transmission [N s/m]"
        damper = group.gain("damper", "c_t", meaning, damping.beta * stiffness, "damper")
        b.connect(rate, damper)
        force = group.sum("force", "force of the transmission [N]")
        b.term(force, spring, 1)
        b.term(force, damper, 1)
    back = group.gain("back", "i", words, chain.ratio, "geometry")
    b.connect(force, back, "f [N]")
    b.term(head.forces, back, -1, "i f [N]")
    b.term(tail.forces, force, 1, "f [N]")
    return tail


def axis_chain(system: MechanicalSystem, axis: AxisPort, *, pushed_mass: float) -> AxisChain:
    r"""Return an equivalent two-mass model of an axis, or one mass if two are not positive.

    `pushed_mass`, of the body that the drive pushes [kg], is the input mass if the displacement is
    imposed: it takes no part in the modes. The model reproduces, in closed form, the static
    elongation and reading for a unit of the drive, and for the dominant mode its frequency
    :math:`\omega`, its shape :math:`(\phi_d, \phi_p)` and its modal mass 1,

    .. math:: k_t = \frac{\omega^2 - (k_{in} + k_s)\phi_d^2}{(\phi_p - i\phi_d)^2}, \quad
              m_{out} = \frac{k_t (\phi_p - i\phi_d)}{\omega^2\phi_p}, \quad
              m_{in} = \frac{1 - m_{out}\phi_p^2}{\phi_d^2}.

    Examples
    --------
    >>> from flexstage.stage.designs import design
    >>> from flexstage.lumped import lumped_system
    >>> system = lumped_system(design("vgtu-piezo"))
    >>> chain = axis_chain(system, system.axes[0], pushed_mass=0.0143)
    >>> round(chain.ratio, 3), round(chain.frequency_hz, 1)
    (1.777, 910.3)
    """
    drive, probe = system.drive(axis.drive), system.probe(axis.probe).vector
    in_place = modes(system, drives="in place", count=None)
    drive_stiffness = drive.stiffness or 0.0
    shape, stiffness = _unit_elongation(system, axis.drive)
    ratio = float(probe @ shape)
    if abs(ratio) <= 1e-12:
        raise ModelError(f"drive '{axis.drive}' does not move probe '{axis.probe}'")
    phi_p = probe @ in_place.shapes

    def chain(k_t: float, m_in: float, m_out: float, omega: float) -> AxisChain:
        return AxisChain(
            ratio=ratio,
            input_stiffness=stiffness,
            transmission_stiffness=k_t,
            input_mass=m_in,
            output_mass=m_out,
            frequency_hz=float(omega / (2.0 * np.pi)),
        )

    if drive.stiffness is None:
        share = phi_p * (in_place.shapes.T @ (system.mass_matrix("in place") @ shape))
        first = int(np.argmax(np.abs(share)))
        if abs(share[first]) < _ONE_MASS * abs(ratio):
            # the probe follows the imposed displacement directly
            bare = modes(system, drives="removed", count=1).omega[0]
            return chain(0.0, stiffness / float(bare**2), 0.0, bare)
        omega, at_p = in_place.omega[first], float(phi_p[first])
        return chain(float(omega**2) / at_p**2, pushed_mass, 1.0 / at_p**2, omega)
    phi_d = drive.vector @ in_place.shapes
    first = int(np.argmax(np.abs(phi_p * phi_d / in_place.omega**2)))
    omega = in_place.omega[first]
    omega2 = float(omega**2)
    at_d, at_p = float(phi_d[first]), float(phi_p[first])
    swing = at_p - ratio * at_d
    if abs(swing) > _ONE_MASS * abs(at_p):
        k_t = (omega2 - (stiffness + drive_stiffness) * at_d**2) / swing**2
        m_out = k_t * swing / (omega2 * at_p)
        m_in = (1.0 - m_out * at_p**2) / at_d**2
        if k_t > 0.0 and m_out > 0.0 and m_in > 0.0:
            return chain(k_t, m_in, m_out, omega)
    return chain(0.0, (stiffness + drive_stiffness) / omega2, 0.0, omega)


def _unit_elongation(system: MechanicalSystem, name: str) -> tuple[Array, float]:
    """Return shape and force for a unit elongation of one drive, the others in place."""
    drive = system.drive(name)
    added = np.zeros_like(system.K)
    columns = [drive.vector]
    for d in system.drives:
        if d.name == name or d.stiffness == 0.0:
            continue
        if d.stiffness is None:
            columns.append(d.vector)
        else:
            added += d.stiffness * np.outer(d.vector, d.vector)
    constraints = np.stack(columns, axis=1)
    n, m = constraints.shape
    saddle = np.block([[system.K + added, constraints], [constraints.T, np.zeros((m, m))]])
    right = np.zeros(n + m)
    right[n] = 1.0
    # scaled, since lengths and angles differ in size
    size = np.concatenate((np.sqrt(np.diag(system.K + added)), np.ones(m)))
    solution = np.linalg.solve(saddle / np.outer(size, size), right / size) / size
    return solution[:n], -float(solution[n])
