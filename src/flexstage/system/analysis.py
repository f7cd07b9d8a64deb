"""Everything that is said of a stage by one model: statics, modes, responses, characteristics."""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from flexstage.characteristic import Characteristic, Characteristics
from flexstage.material import Material
from flexstage.provenance import Provenance, provenance
from flexstage.quantities import QUANTITIES
from flexstage.short_repr import short_repr
from flexstage.stage import Stage
from flexstage.system.linalg import generalized_modes
from flexstage.system.mechanical import DriveCondition, MechanicalSystem
from flexstage.system.modes import Modes, modes
from flexstage.system.response import (
    FrequencyResponse,
    default_frequencies_hz,
    frequency_response,
)
from flexstage.system.statics import AxisAnalysis, analyse_axis, probe_stiffness, static_loads


def axis_mode(system: MechanicalSystem, result: Modes, drive: str, probe: str) -> int:
    r"""Return the mode by which a drive moves a probe.

    It is the one that gives most of the static response, by
    :math:`|p^T\phi\,\phi^T d|/\omega^2`.
    """
    p = system.probe(probe).vector @ result.shapes
    d = system.drive(drive).vector @ result.shapes
    with np.errstate(divide="ignore", invalid="ignore"):
        return int(np.nanargmax(np.abs(p * d) / result.omega**2))


def axis_characteristics(
    stage: Stage, system: MechanicalSystem, axis: AxisAnalysis, removed: Modes
) -> list[Characteristic]:
    """Return the characteristics of one axis.

    `axis` is at full stroke, `removed` has the modes with the drives removed.
    """
    ratio = axis.output_displacement / axis.input_displacement
    others = [a for a in system.axes if a.name != axis.axis]
    static = axis.static
    port = system.drive(axis.drive)
    rows: list[Characteristic] = []

    def add(quantity: str, value: float, note: str, uncertainty: float | None = None) -> None:
        rows.append(
            Characteristic(
                quantity=quantity,
                axis=axis.axis,
                origin=system.model,
                value=float(value),
                unit=QUANTITIES[quantity].unit,
                uncertainty=uncertainty,
                note=note,
            )
        )

    pushed = "imposed" if port.stroke is not None else "at its largest force"
    add("input_displacement", axis.input_displacement, f"elongation of the drive, {pushed}")
    add(
        "output_displacement",
        axis.output_displacement,
        f"probe '{axis.probe}', other drives removed",
    )
    add("transmission_ratio", ratio, "output over input displacement")
    if static.hinge_stress:
        worst = max(static.hinge_stress, key=lambda k: static.hinge_stress[k])
        stress = static.hinge_stress[worst]
        scatter = None if system.stress is None else system.stress.scatter(static.q)[worst]
        add(
            "max_stress",
            stress,
            f"equivalent stress at hinge '{worst}', full stroke",
            # nothing is known of it where the stress comes from no mesh
            scatter or None,
        )
        if stage.material.yield_strength is not None and stress > 0.0:
            add("safety_factor", stage.material.yield_strength / stress, "against yield")
        fatigue = _fatigue(stage.material, stress)
        if fatigue is not None:
            add("fatigue_safety", *fatigue)
    if port.smallest_displacement is not None:
        add(
            "resolution",
            abs(ratio) * port.smallest_displacement,
            "smallest step of the drive times ratio",
        )
    mode = axis_mode(system, removed, axis.drive, axis.probe)
    add("natural_frequency_hz", removed.frequency_hz[mode], f"mode {mode + 1}, drives removed")
    if others and axis.output_displacement != 0.0:
        cross = [static.readings[a.probe] / axis.output_displacement for a in others]
        add(
            "cross_coupling",
            max(cross, key=abs),
            "displacement of the other axis over that of this one",
        )
    body = system.probe(axis.probe).body
    if body in static.body_motion:
        add("parasitic_rotation", static.body_motion[body][2], f"of body '{body}' at full stroke")
    add("input_stiffness", axis.input_stiffness, "force of the drive over its elongation")
    stiffness = probe_stiffness(system, axis.probe, drives="in place")
    if stiffness < math.inf:
        where = f"against a force at probe '{axis.probe}', drives in place (rigid ones locked)"
        add("output_stiffness", stiffness, where)
    for quantity, value, note in _loaded(stage, system, axis.probe):
        add(quantity, value, note)
    return rows


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


_CONDITIONS: tuple[DriveCondition, ...] = ("removed", "in place", "locked")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Analysis:
    """What one model says of a stage."""

    stage: Stage
    """The stage."""
    system: MechanicalSystem
    """The system that was analysed."""
    axes: tuple[AxisAnalysis, ...]
    """Static state of each axis."""
    modes: dict[DriveCondition, Modes]
    """Modes by condition of the drives."""
    responses: tuple[FrequencyResponse, ...]
    """Response of each axis' probe to its drive, drives removed and in place."""
    characteristics: Characteristics
    """The figures that are quoted."""
    validity: tuple[str, ...]
    """Where they stop being valid."""
    provenance: Provenance
    """Where they come from."""

    __repr__ = short_repr

    @property
    def hinge_stress(self) -> dict[str, dict[str, float]]:
        """Largest equivalent stress of each hinge at full stroke, by axis [Pa]."""
        return {a.axis: a.static.hinge_stress for a in self.axes}


def analyse(stage: Stage, system: MechanicalSystem) -> Analysis:
    """Analyse a stage by one of its systems.

    Parameters
    ----------
    stage : Stage
        The stage.
    system : MechanicalSystem
        A model of it.

    Returns
    -------
    Analysis
        Statics of each axis, modes in each condition of the drives, responses, characteristics.

    Raises
    ------
    ModelError
        The stage is a mechanism, or a drive has no stroke.
    """
    axes = tuple(analyse_axis(system, axis) for axis in system.axes)
    # without drives the three conditions are one
    conditions = _CONDITIONS if system.drives else _CONDITIONS[:1]
    found: dict[DriveCondition, Modes] = {c: modes(system, drives=c, count=12) for c in conditions}
    responses = []
    for axis in system.axes:
        for condition in conditions[:2]:
            f = default_frequencies_hz(found[condition])
            responses.append(
                frequency_response(system, f, axis.drive, axis.probe, drives=condition)
            )
    rows: list[Characteristic] = []
    for axis in axes:
        rows += axis_characteristics(stage, system, axis, found["removed"])
    return Analysis(
        stage=stage,
        system=system,
        axes=axes,
        modes=found,
        responses=tuple(responses),
        characteristics=Characteristics(rows),
        validity=(*system.validity, *_missing(system, found["removed"])),
        provenance=provenance(stage, system.settings),
    )


def _missing(system: MechanicalSystem, bare: Modes) -> tuple[str, ...]:
    """Say what a description leaves out that the figures above would need."""
    notes = []
    if not system.axes:
        notes.append("No axis is named (a drive and the probe that reads it): modes only.")
    f = bare.frequency_hz
    # rounding leaves 1e-8 of the highest frequency in place of nothing
    loose = int((f <= 1e-6 * f.max(initial=0.0)).sum())
    if loose:
        notes.append(
            f"{loose} of these modes, at 0 Hz, deform no hinge: a body is not constrained."
        )
    return tuple(notes)
