"""The characteristics of a stage by one model, and the states of its axes."""

import math
from collections.abc import Iterator, Mapping
from functools import partial
from itertools import product
from typing import NamedTuple

import numpy as np

from flexstage.base.arrays import Array
from flexstage.base.errors import ModelError
from flexstage.quantities.characteristic import WHOLE_STAGE, Characteristic
from flexstage.quantities.material import Material
from flexstage.quantities.quantity import QUANTITIES, number
from flexstage.stage import Force, PiezoStack, Stage, mass_properties
from flexstage.stage.contour import has_sharp_root
from flexstage.stage.mass import outer_size
from flexstage.system.coupled_axes import MOST_DRIVES, CoupledAxes, coupled_axes
from flexstage.system.figure_source import AxisMeasures, axis_figures, axis_quantity, stress_figures
from flexstage.system.mechanical import MechanicalSystem
from flexstage.system.modes import Modes, generalized_modes
from flexstage.system.seated_drives import static_drives
from flexstage.system.statics import (
    AxisAnalysis,
    analyse_axis,
    probe_stiffness,
    static_loads,
    static_state,
)
from flexstage.system.thermal import drift_rows
from flexstage.system.thermal_transient import time_constant_row, transient_rows


def _coupling(stage: Stage, system: MechanicalSystem) -> CoupledAxes | None:
    """Return the coupling of all drives and axes; None where there is none, or it is undefined."""
    if len({drive for axis in system.axes for drive in axis.drives}) < 2:
        return None
    try:
        coupling = coupled_axes(stage, system)
    except ModelError:
        # drives that hold the same: then each is looked at by itself
        if any(len(axis.drives) > 1 for axis in system.axes):
            raise
        return None
    return coupling


class AxisStates(NamedTuple):
    """States of the axes of a stage under its drives."""

    coupling: CoupledAxes | None
    """Coupling of all drives and axes; None with one drive, or with redundant drives."""
    together: CoupledAxes | None
    """The same where all drives together make the motion of each axis; else each has its own."""
    axes: tuple[AxisAnalysis, ...]
    """Each axis at full stroke."""


def axis_states(stage: Stage, system: MechanicalSystem) -> AxisStates:
    """Return the coupling of drives and axes, and the state of each axis at full stroke.

    Raises
    ------
    ModelError
        The stage is a mechanism, or a drive has no stroke.
    """
    coupling = _coupling(stage, system)
    together = coupling if coupling is not None and coupling.coupled else None
    if (
        together is not None
        and not together.independent
        and all(len(axis.drives) == 1 for axis in system.axes)
    ):
        # no way to move one axis alone: each drive by itself, as it is
        together = None
    axes = tuple(
        analyse_axis(system, axis)
        if together is None
        else decoupled_axis(system, together, axis.name)
        for axis in system.axes
    )
    return AxisStates(coupling, together, axes)


def decoupled_axis(system: MechanicalSystem, coupled: CoupledAxes, axis: str) -> AxisAnalysis:
    """Return the longest motion along an axis alone, made by all drives together.

    Parameters
    ----------
    system : MechanicalSystem
        The system.
    coupled : CoupledAxes
        Coupling of its drives and axes.
    axis : str
        Name of the axis.

    Returns
    -------
    AxisAnalysis
        The motion from its beginning to its end, and the change of stress.

    Raises
    ------
    ModelError
        The drives cannot move every axis alone.
    """
    moved = coupled.elongations(axis)
    force = coupled.forces @ moved
    state = static_state(
        system, coupled.shapes @ moved, dict(zip(coupled.drives, force.tolist(), strict=True))
    )
    largest = float(np.abs(moved).max())
    probe = coupled.axes[coupled.names.index(axis)].probe
    return AxisAnalysis(
        axis=axis,
        drives=dict(zip(coupled.drives, moved.tolist(), strict=True)),
        probe=probe,
        input_displacement=largest,
        output_displacement=state.readings[probe],
        input_stiffness=float(moved @ force) / largest**2,
        static=state,
    )


def stress_anywhere(system: MechanicalSystem, coupled: CoupledAxes) -> dict[str, float]:
    """Return the largest stress of each hinge with the drives anywhere within their strokes.

    Stress is convex in the elongations, so that it is largest where each drive is at an end of its
    stroke.

    Parameters
    ----------
    system : MechanicalSystem
        The system.
    coupled : CoupledAxes
        Coupling of its drives and axes.

    Returns
    -------
    dict of str to float
        Largest equivalent stress by hinge [Pa]; empty where the system knows no stress.

    Raises
    ------
    ModelError
        There are more than 12 drives.
    """
    if system.stress is None:
        return {}
    if len(coupled.drives) > MOST_DRIVES:
        raise ModelError(
            f"stress at the ends of the strokes is computed for at most {MOST_DRIVES} drives, got "
            f"{len(coupled.drives)}"
        )
    ends = (system.stress.largest(coupled.shapes @ np.array(w)) for w in product(*coupled.strokes))
    worst: dict[str, float] = {}
    for stress in ends:
        worst = {hinge: max(size, worst.get(hinge, 0.0)) for hinge, size in stress.items()}
    return worst


#: Natural frequencies that differ by less are one [1].
SAME_FREQUENCY = 1e-3
#: Shares of a response that differ by less, as a part of the larger, are equal [1].
AS_MUCH = 1e-3
# relative scatter of a largest stress, read at points of a mesh, from mesh to mesh [1].
_AT_POINTS = 1e-2
#: End of the note on a stress that grows with the mesh without a limit, and on its factors.
NO_LIMIT = "not converged at a sharp root"
#: Number of modes among which that of an axis is selected.
MODES_SEARCHED = 12


def axis_mode(
    system: MechanicalSystem, result: Modes, drive: str | Mapping[str, float], probe: str
) -> int:
    r"""Return the mode by which a drive, or drives with given forces, moves a probe.

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

    Of two equal, coupled axes both modes give half, and rounding would decide between them.
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
    static, port, add = axis.static, system.probe(axis.probe), _Rows(system.model, axis.axis)
    mode = axis_mode(system, removed, static.drive_force, axis.probe)
    frequency_hz = removed.frequency_hz
    # modes of one frequency mix arbitrarily; only their sum is well defined
    same_frequency = np.abs(frequency_hz / frequency_hz[mode] - 1.0) < SAME_FREQUENCY
    reading_squares = np.sum((port.vector @ removed.shapes[:, same_frequency]) ** 2)
    stiffness = probe_stiffness(system, axis.probe, drives="in place")
    stress = static.hinge_stress
    hinge = max(stress, key=lambda name: stress[name], default="")
    ratio = np.float64(axis.output_displacement) / axis.input_displacement
    gains = dict.fromkeys(axis.drives, ratio) if coupled is None else coupled.gains(axis.axis)
    measures = AxisMeasures(
        input=lambda: axis.input_displacement,
        output=lambda: axis.output_displacement,
        stress=lambda: stress[hinge],
        strength=partial(_strength, stage.material),
        step=lambda name: (
            np.float64(gains[name]) * (system.drive(name).smallest_displacement or 0.0)
        ),
        frequency_hz=lambda: frequency_hz[mode],
        reading_squares=lambda: reading_squares,
        worst=lambda probes: max((static.readings[p] for p in probes), key=abs),
        rotation=lambda: static.body_motion[port.body][2],
        input_stiffness=lambda: axis.input_stiffness,
        output_stiffness=lambda: stiffness,
        sag=lambda: _sag(stage, system, axis.probe),
        yields=stiffness < math.inf,
        visible=bool(reading_squares),
    )
    published = {(row.quantity, row.axis) for row in stage.published}
    stacks = any(isinstance(d, PiezoStack) and d.name in axis.drives for d in stage.drives)
    both = stacks and ("natural_frequency_hz", axis.axis) not in published
    which = "mode" if same_frequency.sum() == 1 else f"the {same_frequency.sum()} modes like"
    notes = {
        **_motion_notes(system, axis, alone=coupled is None),
        **_stress_notes(
            stage.material,
            f"hinge '{hinge}', {_over(coupled)}",
            _has_no_limit(stage, system, hinge),
        ),
        "natural_frequency_hz": f"mode {mode + 1}, "
        + ("without stack (drives removed)" if both else "drives removed"),
        axis_quantity(
            "effective_mass", port.unit
        ): f"modal mass of {which} {mode + 1} (drives removed), normalised to unit motion at the "
        "probe",
    }
    for quantity, value in axis_figures(system, axis, stage.material, measures):
        note = notes[quantity]
        known = quantity == "max_stress" and NO_LIMIT not in note
        add(quantity, value(), note, _scatter(axis, hinge) if known else None)
        frequency = quantity == "natural_frequency_hz"
        if frequency and both and in_place is not None and in_place.frequency_hz.size:
            driven = axis_mode(system, in_place, static.drive_force, axis.probe)
            condition = f"mode {driven + 1}, with stack (drives in place)"
            add("natural_frequency_with_stack_hz", in_place.frequency_hz[driven], condition)
    for quantity, value, note in (
        *_on_seats(stage, system, axis, float(frequency_hz[mode])),
        *_loaded(system, axis.probe),
        *transient_rows(stage, system, axis.probe),
    ):
        add(quantity, value, note)
    for quantity, value, note, uncertainty in drift_rows(stage, system, axis.axis, axis.probe):
        add(quantity, value, note, uncertainty)
    return add.rows


def _on_seats(
    stage: Stage, system: MechanicalSystem, axis: AxisAnalysis, bare_hz: float
) -> Iterator[tuple[str, float, str]]:
    r"""Yield what the drives of an axis do on their seats, where they have any.

    A drive that moves as a sine over its stroke, without pulling, lifts off at
    :math:`f_0\sqrt{2 (1 + k_0/k_{in}) + F_0/(k_{in} A)}`, with the natural frequency f0 without
    drives, the preload F0, its spring k0, the input stiffness and half the stroke A.
    """
    drives = [d for d in stage.drives if d.name in axis.drives]
    if not any(d.seats or d.preload for d in drives) or any(isinstance(d, Force) for d in drives):
        return
    if system.probe(axis.probe).unit == "m":
        # an elongation of the analysis is that of the drive with its preload spring; one that
        # shortens begins extended
        strokes = {
            d.name: axis.drives[d.name]
            * (d.stroke or 0.0)
            / (system.drive(d.name).stroke or math.inf)
            for d in drives
        }
        begin, end = (
            static_drives(stage, system, {n: max(sign * w, 0.0) for n, w in strokes.items()})
            for sign in (-1.0, 1.0)
        )
        forces = (max(s.drives[n].contact_force for s in (begin, end)) for n in strokes)
        pressing = ", ".join(f"{force:.1f} N" for force in forces)
        yield (
            "working_displacement",
            end.static.readings[axis.probe] - begin.static.readings[axis.probe],
            f"drives on their seats, contact force up to {pressing}",
        )
    ratios = []
    for drive in drives:
        force = abs(axis.static.drive_force[drive.name])
        if drive.preload and not drive.pulls and force > 0.0:
            spring = drive.preload.spring_stiffness * abs(axis.drives[drive.name])
            ratios.append(2.0 * (1.0 + spring / force) + 2.0 * drive.preload.force / force)
    if ratios:
        lifts = bare_hz * math.sqrt(min(ratios))
        yield "lift_off_frequency_hz", lifts, "of a sine over the whole stroke, one mode"


def _over(coupled: CoupledAxes | None) -> str:
    """Return the range of motion over which the stress of an axis is the largest, as text."""
    if coupled is None:
        return "full stroke"
    return "change over the stroke (the stage has the largest stress)"


def _has_no_limit(stage: Stage, system: MechanicalSystem, hinge: str) -> bool:
    """Return whether the stress of a hinge has no limit that finer meshes come to."""
    on_mesh = system.stress is not None and system.stress.point is not None
    return on_mesh and any(h.name == hinge and has_sharp_root(stage, h) for h in stage.hinges)


def _scatter(axis: AxisAnalysis, hinge: str) -> float | None:
    """Return the scatter of the largest stress of an axis on its mesh [Pa]."""
    static = axis.static
    if static.stress is None:
        return None
    scatter = static.stress.of(hinge).scatter(static.q)[hinge]
    # nothing is known of its scatter where the stress comes from no mesh; on one, elements that
    # agree at a point do not know that it lies elsewhere on the next
    return scatter + _AT_POINTS * static.hinge_stress[hinge] if scatter else None


def _sag(stage: Stage, system: MechanicalSystem, probe: str) -> float:
    """Return the reading of a probe under the weight along its direction."""
    c, s = stage.probe(probe).along
    weight = {"gravity x": c, "gravity y": s}
    return static_loads(system, weight, drives="in place").readings[probe]


def _motion_notes(system: MechanicalSystem, axis: AxisAnalysis, *, alone: bool) -> dict[str, str]:
    """Return the notes on the figures of a motion, by one drive `alone` or by all together."""
    port = system.probe(axis.probe)
    unit, turns = port.unit, port.unit == "rad"
    if alone:
        stroke = system.drive(axis.drive).stroke
        pushed = "imposed" if stroke is not None else "at its largest force"
        pushed, rest = f"elongation of the drive, {pushed}", "other drives removed"
    else:
        largest = max(axis.drives, key=lambda name: abs(axis.drives[name]))
        pushed = f"largest elongation of a drive ('{largest}') in a motion of this axis alone"
        rest = "this axis alone, all drives within their strokes"
    together = len(axis.drives) > 1
    how = "after decoupling" if together else "at full stroke"
    # of the kind of its own: not in parts of a motion that is next to none
    hardly = "; this axis itself hardly moves"
    cross = f"largest of the other axes, {how}"
    return {
        "input_displacement": pushed,
        axis_quantity("output_displacement", unit): f"probe '{axis.probe}', {rest}",
        "transmission_ratio": "output over input displacement",
        axis_quantity("resolution", unit): "smallest step of the drive times ratio"
        + ("" if alone else ", the largest"),
        "cross_coupling": "displacement of the other axis over that of this one"
        + f", {how}" * together,
        "cross_rotation": cross + hardly * turns,
        "cross_displacement": cross + hardly * (not turns),
        "parasitic_rotation": f"of body '{port.body}' at full stroke",
        "input_stiffness": "force of the drive over its elongation"
        if alone
        else "twice the energy of the motion over the square of the input displacement",
        axis_quantity("output_stiffness", unit): f"against a {'moment' if turns else 'force'} at "
        f"probe '{axis.probe}', drives in place (rigid ones locked)",
        "gravity_sag": "1 g along the axis, drives in place (rigid ones locked)",
    }


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

    def stress(self, material: Material, stress: float, where: str, no_limit: bool) -> None:
        """Add a largest stress, and its safety factors against yield and fatigue."""
        notes = _stress_notes(material, where, no_limit)
        strength = partial(_strength, material)
        for quantity, value in stress_figures(material, strength, lambda: stress, stress > 0.0):
            self(quantity, value(), notes[quantity])


def _strength(material: Material, which: int) -> float | None:
    return pulsating_limit(material) if which else material.yield_strength


def _stress_notes(material: Material, where: str, no_limit: bool) -> dict[str, str]:
    """Return the notes on a largest stress, which may have no limit, and its safety factors.

    Soderberg's line (C. R. Soderberg, Trans. ASME 52 (1930) APM-52-2), with half of the stress as
    its mean and half as its amplitude: 1/n = sigma_a/sigma_f + sigma_m/sigma_y.
    """
    cycles = f", {material.fatigue_cycles:.0e} cycles" if material.fatigue_cycles else ""
    notes = {
        "max_stress": f"equivalent stress at {where}",
        "safety_factor": "against yield",
        "fatigue_safety": f"pulsating load, zero to full stroke, Soderberg line{cycles}",
    }
    return {name: f"{note}; {NO_LIMIT}" if no_limit else note for name, note in notes.items()}


def scatter_at_points(row: Characteristic) -> float:
    """Return the uncertainty of a largest stress by the elements about its point.

    It excludes the scatter between meshes, for use where several meshes are known.
    """
    return max((row.uncertainty or 0.0) - _AT_POINTS * abs(row.value), 0.0)


def pulsating_limit(material: Material) -> float | None:
    r"""Return the largest peak stress that fatigue allows under pulsating load.

    Soderberg's line (C. R. Soderberg, Trans. ASME 52 (1930) APM-52-2), with half of the peak as
    mean and half as amplitude: 1/sigma = (1/sigma_f + 1/sigma_y)/2.

    The peak is in Pa, and None if fatigue limit or yield strength is unknown.

    Examples
    --------
    >>> from flexstage.quantities.material import material
    >>> print(f"{pulsating_limit(material('Al 7075-T6')) / 1e6:.0f} MPa")
    242 MPa
    """
    limit, strength = material.fatigue_limit, material.yield_strength
    if limit is None or strength is None:
        return None
    return 2.0 / (1.0 / limit + 1.0 / strength)


def _loaded(system: MechanicalSystem, probe: str) -> Iterator[tuple[str, float, str]]:
    """Yield thermal drift, and stiffness and frequency out of the plane, if the model has them."""
    load_names = {load.name for load in system.loads}
    if system.probe(probe).unit == "rad":
        return
    if "temperature" in load_names:
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
    """Return the characteristics of the stage: size, mass, coupling and workspace."""
    model = system.model
    add = _Rows(model, WHOLE_STAGE)
    masses = {name: properties.mass for name, properties in mass_properties(stage).items()}
    add("mass", sum(masses.values()), "all bodies and the masses mounted on them")
    moving = sum(masses[body.name] for body in stage.bodies if not body.fixed)
    add("moving_mass", moving, "all bodies that are not fixed")
    for quantity, value, note in time_constant_row(stage, system):
        add(quantity, value, note)
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
        where = f"hinge '{worst}', drives anywhere within their strokes"
        no_limit = _has_no_limit(stage, system, worst)
        add.stress(stage.material, stress[worst], where, no_limit)
    reached = coupling.workspace
    if reached is not None:
        over = _Rows(model, "".join(reached.axes[:2]))
        at = " at the middle rotation" if len(reached.axes) > 2 else ""
        over("workspace_area", reached.area, f"all drives over their strokes{at}")
        add.rows += over.rows
    return add.rows
