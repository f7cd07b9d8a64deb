"""Structural diagram of a stage, from the equations of its bodies and hinges."""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from scipy.linalg import eigh
from scipy.optimize import nnls

from flexstage.base.arrays import Array
from flexstage.base.choose import has_no
from flexstage.base.errors import ModelError
from flexstage.export.diagram.blocks import (
    BodyBlocks,
    DriveSpring,
    add_body,
    add_drive,
    add_drive_chain,
    add_hinge,
    add_probe_chain,
    add_reading,
)
from flexstage.export.diagram.graph import Diagram, DiagramBuilder, GroupBuilder
from flexstage.hysteresis.build_model import dynamic_model
from flexstage.hysteresis.dynamic_model import DynamicModel, ModelDrive, ModelProbe
from flexstage.lumped import Mechanism, lumped_system, mechanism
from flexstage.stage import Stage
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


#: Largest relative change of the lowest frequencies by a replacement of an imposed displacement.
_CHANGE = 1e-3
#: Number of these frequencies.
_WATCHED = 6
_STEPS = tuple(digit * 10.0**power for power in range(-2, 10) for digit in (1.0, 2.0, 5.0))


def stage_diagram(
    stage: Stage,
    *,
    model: DynamicModel | None = None,
    axis: str | None = None,
    damping: RayleighDamping | None = None,
) -> Diagram:
    """Return the structural diagram of a stage, from commands to readings.

    Bodies are rigid, with three coordinates each; hinges are springs of two translations and a
    rotation (`flexstage.lumped`). Damping is proportional: beta K in each hinge, alpha M at each
    body. A stiff spring replaces an imposed displacement of a drive.

    Parameters
    ----------
    stage : Stage
        The stage.
    model : DynamicModel, optional
        Amplifiers, hysteresis, creep and sensors; by default those of
        `hysteresis.dynamic_model`.
    axis : str, optional
        Name of an axis: two masses with springs and a lever, on one page. By default the entire
        stage, as for the Simulink script.
    damping : RayleighDamping, optional
        Damping; by default fitted to the two lowest modes, drives in place.

    Returns
    -------
    Diagram
        The diagram.

    Raises
    ------
    ModelError
        Every body is fixed, the stage can move without deforming a hinge, it has no drive, or there
        is no such axis.

    Notes
    -----
    Validity: that of the lumped model (small motion, rigid bodies). Damping is exact for two modes;
    higher modes are damped more strongly in the diagram. From a finite-element model the diagram
    has drive chains, sensors and damping; bodies and hinges are always those of the lumped model.
    Two masses reproduce statics and one mode of an axis exactly, and have no other modes.

    Examples
    --------
    >>> from flexstage.stage.designs import design
    >>> diagram = stage_diagram(design("vgtu-piezo"))
    >>> len(diagram.groups), sum(b.kind == "integrator" for b in diagram.blocks)
    (56, 40)
    """
    method, plane = _hinge_choice(model)
    system = lumped_system(stage, method=method, plane=plane)
    heavy = [d.name for d in system.drives if d.mass]
    # the bodies of the diagram are those of the stage
    bare = tuple(replace(d, mass=0.0, ends=None) for d in system.drives)
    system = replace(system, drives=bare)
    if model is None:
        model = dynamic_model(stage, system)
    system = system.with_damping(model.system.damping)
    parts = mechanism(stage, method=method, plane=plane)
    rayleigh = fitted_damping(system) if damping is None else damping
    springs = drive_springs(system)
    notes = _notes(system, rayleigh, springs)
    if heavy:
        notes = (*notes, f"The masses of the drives {', '.join(heavy)} are not in the diagram.")
    if axis is not None:
        return _axis(parts, system, model, axis, springs, rayleigh)
    return whole_stage(
        parts,
        model,
        springs=springs,
        damping=rayleigh,
        title=f"Structural diagram of {stage.name}" + (f": {stage.title}" if stage.title else ""),
        notes=(*notes, *_model_notes(model)),
    )


def _axis(
    parts: Mechanism,
    system: MechanicalSystem,
    model: DynamicModel,
    name: str,
    springs: dict[str, DriveSpring],
    damping: RayleighDamping,
) -> Diagram:
    """Return the diagram of one axis."""
    ports = {port.name: port for port in system.axes}
    if name not in ports:
        raise ModelError(has_no(f"stage '{system.name}'", "axis", name, ports))
    port = ports[name]
    pushed = parts.bodies[parts.drive(port.drive).bodies[1]]
    chain = axis_chain(system, port, pushed_mass=pushed.mass)
    validity = (
        f"Two masses represent the axis: they reproduce its statics and the shape of the mode at "
        f"{chain.frequency_hz:.5g} Hz (drives in place); higher modes, motion across and rotation "
        "are neglected."
    )
    if chain.output_mass == 0.0:
        condition = "removed" if springs[port.drive].replaces_imposed else "in place"
        validity = (
            f"One mass represents the axis, with a natural frequency of {chain.frequency_hz:.5g} "
            f"Hz (drives {condition}); other modes, motion across and rotation are neglected."
        )
    return axis_blocks(
        model,
        model.drive(port.drive),
        next(p for p in model.probes if p.name == port.probe),
        chain,
        spring=springs[port.drive],
        damping=damping,
        title=f"Structural diagram of {system.name}, axis {name}",
        notes=(validity, *_notes(system, damping, springs, only=port.drive), *_model_notes(model)),
    )


def _hinge_choice(model: DynamicModel | None) -> tuple[str, Literal["stress", "strain", "auto"]]:
    """Return method and plane state of the hinges of a lumped model; else the defaults."""
    if model is None or model.system.model != "lumped":
        return "wedge", "auto"
    settings = model.system.settings
    planes: dict[str, Literal["stress", "strain"]] = {"stress": "stress", "strain": "strain"}
    return str(settings.get("method", "wedge")), planes.get(str(settings.get("plane")), "auto")


def _notes(
    system: MechanicalSystem,
    damping: RayleighDamping,
    springs: dict[str, DriveSpring],
    only: str | None = None,
) -> tuple[str, ...]:
    in_place = modes(system, drives="in place", count=min(2, system.order))
    ratios = ", ".join(
        f"{100.0 * z:.3g} % at {w / (2.0 * np.pi):.5g} Hz"
        for w, z in zip(
            in_place.omega,
            damping.ratios(in_place.omega, np.ones_like(in_place.omega)),
            strict=True,
        )
    )
    notes = [
        "Lumped model: bodies are rigid, motion is small and in the plane.",
        f"Damping is proportional, alpha = {damping.alpha:.4g} 1/s at the bodies and beta = "
        f"{damping.beta:.4g} s in the hinges and stacks: {ratios}, drives in place; higher modes "
        "are damped more strongly than in the state-space form, which has individual damping.",
    ]
    stiff = {n: s for n, s in springs.items() if s.replaces_imposed and only in (None, n)}
    if stiff:
        each = ", ".join(
            f"{1e-6 * s.stiffness:.4g} N/um in {n}, with an additional mode near "
            f"{1e-3 * s.own_frequency_hz:.3g} kHz"
            for n, s in stiff.items()
        )
        notes.append(
            f"Imposed displacements act through stiff springs without dampers ({each}), which "
            "change the six lowest frequencies by less than 0.1 %: use a solver for stiff "
            "equations."
        )
    return tuple(notes)


def _model_notes(model: DynamicModel) -> tuple[str, ...]:
    """Return the notes of the model on stacks and sensors, without those on its modes."""
    of_drives = ("The hysteresis", "Stacks without", "Of identified drives", "The noise")
    notes = [note for note in model.notes if note.startswith(of_drives)]
    if model.system.model != "lumped":
        notes.append(
            f"Drive chains, sensors and damping are those of the {model.system.model} model; "
            "bodies and hinges are lumped."
        )
    return tuple(notes)


def whole_stage(
    mechanism: Mechanism,
    model: DynamicModel,
    *,
    springs: dict[str, DriveSpring],
    damping: RayleighDamping,
    title: str,
    notes: tuple[str, ...],
) -> Diagram:
    """Return the diagram of an entire stage."""
    builder = DiagramBuilder()
    drives = {sight.name: sight for sight in mechanism.drives}
    groups = {
        d.name: builder.group(f"d_{d.name}", title=f"Drive {d.name} ({d.kind})", kind="drive")
        for d in model.drives
    }
    bodies = {i: add_body(builder, mechanism, i, damping) for i in mechanism.free}
    for hinge in mechanism.hinges:
        add_hinge(builder, mechanism, hinge, bodies, damping)
    for d in model.drives:
        free = add_drive_chain(builder, model, d, groups[d.name])
        add_drive(
            builder, mechanism, drives[d.name], bodies, springs[d.name], damping, free,
            groups[d.name],
        )  # fmt: skip
    by_probe = {sight.name: sight for sight in mechanism.probes}
    for probe in model.probes:
        sight = by_probe[probe.name]
        group = builder.group(f"p_{probe.name}", title=f"Probe {probe.name}", kind="probe")
        read = add_reading(builder, mechanism, sight, bodies, group)
        if read:
            add_probe_chain(builder, probe, read, group)
    return builder.diagram(title, notes)


def drive_springs(system: MechanicalSystem) -> dict[str, DriveSpring]:
    """Return the spring of each drive; a stiff one replaces an imposed displacement.

    It is just stiff enough to change the six lowest frequencies with the drives in place by less
    than 0.1 %.

    Examples
    --------
    >>> from flexstage.stage.designs import design
    >>> from flexstage.lumped import lumped_system
    >>> drive_springs(lumped_system(design("parallelogram")))["x"].replaces_imposed
    True
    """
    springs = {
        d.name: DriveSpring(stiffness=float(d.stiffness))
        for d in system.drives
        if d.stiffness is not None
    }
    rigid = [d for d in system.drives if d.stiffness is None]
    if not rigid:
        return springs
    lowest = modes(system, drives="in place", count=min(_WATCHED, system.order - len(rigid)))
    added = system.drive_springs("in place")[0]
    local = np.array([float(d.vector @ system.K @ d.vector) for d in rigid])
    local = 10.0 ** np.ceil(np.log10(local))
    for step in _STEPS:
        stiffness = local * step
        total = system.K + added
        for k, d in zip(stiffness, rigid, strict=True):
            total = total + k * np.outer(d.vector, d.vector)
        mass, last = system.mass_matrix("in place"), lowest.omega.size - 1
        squares = eigh(total, mass, eigvals_only=True, subset_by_index=(0, last))
        change = np.abs(np.sqrt(np.maximum(squares, 0.0)) / lowest.omega - 1.0)
        if np.all(change < _CHANGE):
            stand_in = {
                d.name: DriveSpring(
                    stiffness=float(k),
                    replaces_imposed=True,
                    own_frequency_hz=_own_frequency(system, d.vector, float(k)),
                )
                for k, d in zip(stiffness, rigid, strict=True)
            }
            return {d.name: (springs | stand_in)[d.name] for d in system.drives}
    raise ModelError(
        f"no spring is stiff enough to replace the rigid drives of '{system.name}': give the "
        "drives a stiffness"
    )


def _own_frequency(system: MechanicalSystem, vector: Array, stiffness: float) -> float:
    """Return the frequency of the pushed bodies alone on a spring [Hz]."""
    mobility = float(vector @ np.linalg.solve(system.mass_matrix("in place"), vector))
    return float(np.sqrt(stiffness * mobility) / (2.0 * np.pi))


def fitted_damping(system: MechanicalSystem) -> RayleighDamping:
    """Return Rayleigh damping with the damping ratios of the two lowest modes, drives in place.

    If alpha and beta cannot both be positive, it is the closest non-negative fit.

    Examples
    --------
    >>> from flexstage.stage.designs import design
    >>> from flexstage.lumped import lumped_system
    >>> damping = fitted_damping(lumped_system(design("vgtu-piezo")))
    >>> round(damping.alpha, 2), round(damping.beta * 1e6, 3)
    (81.84, 0.995)
    """
    if isinstance(system.damping, RayleighDamping):
        return system.damping
    in_place = modes(system, drives="in place", count=min(2, system.order))
    if not np.all(in_place.omega > 0.0):
        raise ModelError(
            f"stage '{system.name}' has a motion without stiffness: constrain it for a diagram"
        )
    ratios = np.asarray(in_place.damping_ratio, dtype=np.float64)
    rows = 0.5 * np.stack((1.0 / in_place.omega, in_place.omega), axis=1)
    # scaled to columns of equal size, else the smaller factor is lost
    size = np.linalg.norm(rows, axis=0)
    alpha, beta = (nnls(rows / size, ratios)[0] / size).tolist()
    return RayleighDamping(alpha=alpha, beta=beta)
