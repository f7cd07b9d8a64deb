"""The characteristics of a stage by one model: of each of its axes, and of the whole."""

import math
from collections.abc import Iterator, Mapping

import numpy as np

from flexstage.arrays import Array
from flexstage.characteristic import WHOLE_STAGE, Characteristic
from flexstage.material import Material
from flexstage.quantities import QUANTITIES, number
from flexstage.stage import PiezoStack, Stage, mass_properties
from flexstage.stage.mass import outer_size
from flexstage.system.axis_states import AxisStates, stress_anywhere
from flexstage.system.coupled_axes import CoupledAxes
from flexstage.system.linalg import generalized_modes
from flexstage.system.mechanical import MechanicalSystem
from flexstage.system.modes import Modes
from flexstage.system.statics import AxisAnalysis, probe_stiffness, static_loads

#: Natural frequencies that differ by less are one [1].
ALIKE = 1e-3
#: Shares of a response that differ by less, as a part of the larger, are equal [1].
AS_MUCH = 1e-3
# what a largest stress, which is read at points of a mesh, differs by from mesh to mesh [1].
_AT_POINTS = 1e-2
#: Modes that are computed, among which that of an axis is sought.
MODES_SEARCHED = 12

# an axis that moves by less than this of what another does is not moved by its drive
_NOTHING = 0.1
# what a figure of an axis is called where the axis is a rotation
_OF_ROTATION = {
    "output_displacement": "rotation_stroke",
    "resolution": "rotation_resolution",
    "output_stiffness": "rotational_stiffness",
    "effective_mass": "effective_inertia",
}


def axis_quantity(quantity: str, unit: str) -> str:
    """Return what a figure of an axis is called, by the unit in which the axis is read."""
    return _OF_ROTATION[quantity] if unit == "rad" else quantity


def axis_mode(
    system: MechanicalSystem, result: Modes, drive: str | Mapping[str, float], probe: str
) -> int:
    r"""Return the mode by which a drive, or drives with their forces, moves a probe.

    It is the one that gives most of the static response, by
    :math:`|p^T\phi\,\phi^T d|/\omega^2` (`strongest`).
    """
    forces = {drive: 1.0} if isinstance(drive, str) else drive
    p = system.probe(probe).vector @ result.shapes
    d = sum(force * system.drive(name).vector for name, force in forces.items()) @ result.shapes
    with np.errstate(divide="ignore", invalid="ignore"):
        return strongest(np.abs(p * d) / result.omega**2)


def strongest(share: Array) -> int:
    """Return the lowest mode that gives the largest share of a response, to `AS_MUCH`.

    Of two axes that are alike and coupled both modes give half; which gives more, rounding says.
    """
    return int(np.flatnonzero(share >= (1.0 - AS_MUCH) * np.nanmax(share))[0])


def every_characteristic(
    stage: Stage,
    system: MechanicalSystem,
    states: AxisStates,
    removed: Modes,
    in_place: Modes | None = None,
) -> list[Characteristic]:
    """Return the characteristics of each axis and of the whole; none where no axis is named.

    There are `MODES_SEARCHED` modes with the drives removed, and with them in place if there are
    drives.
    """
    rows: list[Characteristic] = []
    for axis in states.axes:
        rows += axis_characteristics(stage, system, axis, removed, states.together, in_place)
    return rows + stage_characteristics(stage, system, states.coupling) if rows else rows


def axis_characteristics(
    stage: Stage,
    system: MechanicalSystem,
    axis: AxisAnalysis,
    removed: Modes,
    coupled: CoupledAxes | None = None,
    in_place: Modes | None = None,
) -> list[Characteristic]:
    """Return the characteristics of one axis.

    `axis` is at full stroke, `removed` has the modes with the drives removed; `coupled` is given
    where all drives together make the motion of the axis. An axis that stacks drive has its
    frequency with them `in_place` as well, unless a frequency of it was published, whose condition
    is that of the comparison.
    """
    others = [a for a in system.axes if a.name != axis.axis]
    static, unit = axis.static, system.probe(axis.probe).unit
    turns = unit == "rad"
    ports = {name: system.drive(name) for name in axis.drives}
    add = _Rows(system.model, axis.axis)

    alone = coupled is None
    if alone:
        pushed = "imposed" if ports[axis.drive].stroke is not None else "at its largest force"
        pushed, rest = f"elongation of the drive, {pushed}", "other drives removed"
    else:
        largest = max(axis.drives, key=lambda name: abs(axis.drives[name]))
        pushed = f"largest elongation of a drive ('{largest}') in a motion of this axis alone"
        rest = "this axis alone, all drives within their strokes"
    add("input_displacement", axis.input_displacement, pushed)
    stroke = axis_quantity("output_displacement", unit)
    add(stroke, axis.output_displacement, f"probe '{axis.probe}', {rest}")
    if not turns:
        ratio = axis.output_displacement / axis.input_displacement
        add("transmission_ratio", ratio, "output over input displacement")
    if static.hinge_stress:
        worst = max(static.hinge_stress, key=lambda k: static.hinge_stress[k])
        stress = static.hinge_stress[worst]
        own = None if static.stress is None else static.stress.of(worst)
        scatter = None if own is None else own.scatter(static.q)[worst]
        # nothing is known of its scatter where the stress comes from no mesh; on one, elements that
        # agree at a point do not know that it lies elsewhere on the next
        if scatter:
            scatter += _AT_POINTS * stress
        where = "full stroke" if alone else "change from end to end (the largest is of the stage)"
        add.stress(stage.material, stress, f"hinge '{worst}', {where}", scatter or None)
    steps = {n: p.smallest_displacement for n, p in ports.items() if p.smallest_displacement}
    if steps:
        gains = (
            {axis.drive: axis.output_displacement / axis.input_displacement}
            if coupled is None
            else coupled.gains(axis.axis)
        )
        add(
            axis_quantity("resolution", unit),
            max(abs(gains[name]) * step for name, step in steps.items()),
            "smallest step of the drive times ratio" + ("" if alone else ", the largest"),
        )
    mode = axis_mode(system, removed, static.drive_force, axis.probe)
    published = {(row.quantity, row.axis) for row in stage.published}
    stacks = any(isinstance(d, PiezoStack) and d.name in axis.drives for d in stage.drives)
    both = stacks and ("natural_frequency_hz", axis.axis) not in published
    condition = "without stack (drives removed)" if both else "drives removed"
    add("natural_frequency_hz", removed.frequency_hz[mode], f"mode {mode + 1}, {condition}")
    if both and in_place is not None and in_place.frequency_hz.size:
        driven = axis_mode(system, in_place, static.drive_force, axis.probe)
        condition = f"mode {driven + 1}, with stack (drives in place)"
        add("natural_frequency_with_stack_hz", in_place.frequency_hz[driven], condition)
    for quantity, value, note in _cross(system, axis, [a.probe for a in others]):
        add(quantity, value, note)
    body = system.probe(axis.probe).body
    if body in static.body_motion and not turns:
        add("parasitic_rotation", static.body_motion[body][2], f"of body '{body}' at full stroke")
    add(
        "input_stiffness",
        axis.input_stiffness,
        "force of the drive over its elongation"
        if alone
        else "twice the energy of the motion over the square of the input displacement",
    )
    stiffness = probe_stiffness(system, axis.probe, drives="in place")
    if stiffness < math.inf:
        load = "moment" if turns else "force"
        where = f"against a {load} at probe '{axis.probe}', drives in place (rigid ones locked)"
        add(axis_quantity("output_stiffness", unit), stiffness, where)
    # of modes of one frequency any mixture is one: what they do together is sure
    alike = np.abs(removed.frequency_hz / removed.frequency_hz[mode] - 1.0) < ALIKE
    shown = np.sum((system.probe(axis.probe).vector @ removed.shapes[:, alike]) ** 2)
    if shown:
        which = "mode" if alike.sum() == 1 else f"the {alike.sum()} modes like"
        add(
            axis_quantity("effective_mass", unit),
            1.0 / shown,
            f"modal mass of {which} {mode + 1} (drives removed) where the probe moves by one",
        )
    for quantity, value, note in _loaded(stage, system, axis.probe):
        add(quantity, value, note)
    return add.rows


class _Rows:
    """Rows of one model and axis, as they are added."""

    def __init__(self, model: str, axis: str) -> None:
        self.rows: list[Characteristic] = []
        self._from = (model, axis)

    def __call__(
        self, quantity: str, value: float, note: str, uncertainty: float | None = None
    ) -> None:
        model, axis = self._from
        self.rows.append(
            Characteristic(
                quantity=quantity,
                axis=axis,
                origin=model,
                value=float(value),
                unit=QUANTITIES[quantity].unit,
                uncertainty=uncertainty,
                note=note,
            )
        )

    def stress(
        self, material: Material, stress: float, where: str, scatter: float | None = None
    ) -> None:
        """Add a largest stress, and how far it is from yield and from fatigue."""
        self("max_stress", stress, f"equivalent stress at {where}", scatter)
        if material.yield_strength is not None and stress > 0.0:
            self("safety_factor", material.yield_strength / stress, "against yield")
        fatigue = _fatigue(material, stress)
        if fatigue is not None:
            self("fatigue_safety", *fatigue)


def cross_figures(
    system: MechanicalSystem, axis: AxisAnalysis, others: list[str]
) -> Iterator[tuple[str, list[str]]]:
    """Give the figures that tell what the probes of other axes read over the stroke of one.

    Each is the largest reading of some of them: in parts of its own motion (``cross_coupling``)
    where they are of the same kind, and not nothing beside it; as it is otherwise.
    """
    unit = system.probe(axis.probe).unit
    alike = [p for p in others if system.probe(p).unit == unit]
    unlike = [p for p in others if system.probe(p).unit != unit]
    ways = ("cross_rotation", "cross_displacement")
    if alike:
        worst, own = max(abs(axis.static.readings[p]) for p in alike), abs(axis.output_displacement)
        moves = own >= _NOTHING * worst and own != 0.0
        yield "cross_coupling" if moves else ways[unit == "m"], alike
    if unlike:
        yield ways[unit == "rad"], unlike


def _cross(
    system: MechanicalSystem, axis: AxisAnalysis, others: list[str]
) -> Iterator[tuple[str, float, str]]:
    """Give what the other axes read over the stroke of one."""
    unit = system.probe(axis.probe).unit
    together = len(axis.drives) > 1
    how = "after decoupling" if together else "at full stroke"
    for quantity, probes in cross_figures(system, axis, others):
        worst = max((axis.static.readings[p] for p in probes), key=abs)
        note = f"largest of the other axes, {how}"
        if quantity == "cross_coupling":
            worst /= axis.output_displacement
            note = "displacement of the other axis over that of this one"
            note += f", {how}" * together
        elif system.probe(probes[0]).unit == unit:
            note += "; this axis hardly moves beside it"
        yield quantity, worst, note


def scatter_at_points(row: Characteristic) -> float:
    """Return what the elements about its point leave a largest stress uncertain by.

    Where several meshes tell, what one alone does not know of others is no part of it.
    """
    return max((row.uncertainty or 0.0) - _AT_POINTS * abs(row.value), 0.0)


def _fatigue(material: Material, stress: float) -> tuple[float, str] | None:
    r"""Safety against fatigue when the stroke is gone through again and again.

    Soderberg's line (C. R. Soderberg, Trans. ASME 52 (1930) APM-52-2), with half of the stress as
    its mean and half as its amplitude: 1/n = sigma_a/sigma_f + sigma_m/sigma_y.
    """
    allowed = pulsating_limit(material)
    if allowed is None or stress <= 0.0:
        return None
    cycles = f", {material.fatigue_cycles:.0e} cycles" if material.fatigue_cycles else ""
    note = f"stroke from zero to full and back, Soderberg line{cycles}"
    return allowed / stress, note


def pulsating_limit(material: Material) -> float | None:
    r"""Return the peak stress that fatigue allows when it goes from zero to it and back.

    Soderberg's line (C. R. Soderberg, Trans. ASME 52 (1930) APM-52-2), with half of the peak as
    mean and half as amplitude: 1/sigma = (1/sigma_f + 1/sigma_y)/2.

    The peak is in Pa, and None if fatigue limit or yield strength is unknown.

    Examples
    --------
    >>> from flexstage.material import material
    >>> print(f"{pulsating_limit(material('Al 7075-T6')) / 1e6:.0f} MPa")
    242 MPa
    """
    limit, strength = material.fatigue_limit, material.yield_strength
    if limit is None or strength is None:
        return None
    return 2.0 / (1.0 / limit + 1.0 / strength)


def _loaded(stage: Stage, system: MechanicalSystem, probe: str) -> Iterator[tuple[str, float, str]]:
    """Give what weight and temperature do to a probe, where the model knows."""
    known = {load.name for load in system.loads}
    if system.probe(probe).unit == "rad":
        return
    if {"gravity x", "gravity y"} <= known:
        c, s = stage.probe(probe).along
        weight = {"gravity x": c, "gravity y": s}
        sag = static_loads(system, weight, drives="in place").readings[probe]
        yield "gravity_sag", sag, "1 g along the axis, drives in place (rigid ones locked)"
    if "temperature" in known:
        drift = static_loads(system, {"temperature": 1.0}).readings[probe]
        yield (
            "thermal_drift",
            drift,
            "uniform temperature change, drives removed, base without expansion; for another base, "
            "multiply by (stage coefficient - base coefficient) / stage coefficient",
        )
    body = system.probe(probe).body
    lift = f"{body} out of plane"
    if any(p.name == lift for p in system.probes):
        yield (
            "out_of_plane_stiffness",
            probe_stiffness(system, lift),
            f"against a force on '{body}', normal to the plate",
        )
        index = [i for i, c in enumerate(system.coordinates) if c.startswith("out of plane")]
        omega, _ = generalized_modes(
            system.K[np.ix_(index, index)],
            system.M[np.ix_(index, index)],
            np.zeros((len(index), 0)),
            1,
        )
        yield "out_of_plane_frequency_hz", omega[0] / (2.0 * math.pi), "drives removed or locked"


def stage_characteristics(
    stage: Stage, system: MechanicalSystem, coupling: CoupledAxes | None
) -> list[Characteristic]:
    """Return the characteristics of the whole: size, mass, and what its drives reach together."""
    model = system.model
    add = _Rows(model, WHOLE_STAGE)
    masses = {name: found.mass for name, found in mass_properties(stage).items()}
    add("mass", sum(masses.values()), "all bodies and what is mounted on them")
    moving = sum(masses[body.name] for body in stage.bodies if not body.fixed)
    add("moving_mass", moving, "all bodies that are not fixed")
    for quantity, value in zip(("width", "height", "thickness"), outer_size(stage), strict=True):
        add(quantity, value, "outlines of all bodies, without drives")
    if coupling is None or len(coupling.axes) < 2:
        return add.rows
    if coupling.independent:
        scaled = "displacements per elongation, other drives held"
        if coupling.length is not None:
            scaled += f"; rotations times {number(1e3 * coupling.length)} mm"
        add("condition_number", coupling.condition_number, scaled)
        add("isotropy", coupling.isotropy, scaled)
    if coupling.coupled and (stress := stress_anywhere(system, coupling)):
        worst = max(stress, key=lambda hinge: stress[hinge])
        add.stress(
            stage.material, stress[worst], f"hinge '{worst}', drives anywhere in their strokes"
        )
    reached = coupling.workspace
    if reached is not None:
        over = _Rows(model, "".join(reached.axes[:2]))
        at = " at the middle rotation" if len(reached.axes) > 2 else ""
        over("workspace_area", reached.area, f"all drives over their strokes{at}")
        add.rows += over.rows
    return add.rows
