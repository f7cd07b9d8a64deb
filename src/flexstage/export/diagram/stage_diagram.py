"""Structural diagram of a stage, from the equations of its bodies and hinges."""

from dataclasses import replace
from typing import Literal

import numpy as np
from scipy.linalg import eigh
from scipy.optimize import nnls

from flexstage.base.arrays import Array
from flexstage.base.choose import has_no
from flexstage.base.errors import ModelError
from flexstage.export.diagram.axis_diagram import axis_blocks, axis_chain
from flexstage.export.diagram.blocks import (
    DriveSpring,
    add_body,
    add_drive,
    add_drive_chain,
    add_hinge,
    add_probe_chain,
    add_reading,
)
from flexstage.export.diagram.graph import Diagram, DiagramBuilder
from flexstage.hysteresis.build_model import dynamic_model
from flexstage.hysteresis.dynamic_model import DynamicModel
from flexstage.lumped import Mechanism, lumped_system, mechanism
from flexstage.stage import Stage
from flexstage.system import MechanicalSystem, RayleighDamping, modes

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
