"""Thermal drift of a stage on its bench, with its drives in place."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

from flexstage.base.errors import ModelError
from flexstage.base.short_repr import short_repr
from flexstage.quantities.quantity import number
from flexstage.stage.bench import Bench
from flexstage.stage.drive import Drive, Force
from flexstage.stage.model import Stage
from flexstage.system.mechanical import MechanicalSystem
from flexstage.system.seated_drives import SeatedState, static_drives


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ThermalDrift:
    """Drift of a stage by a uniform change of temperature, with its drives in place."""

    readings: Mapping[str, float]
    """Reading of each probe [m/K, or rad/K]."""
    readings_uncertainty: Mapping[str, float]
    """Its standard uncertainty by the coefficients of the drives."""
    rotations: Mapping[str, float]
    """Rotation of each body [rad/K]."""
    rotations_uncertainty: Mapping[str, float]
    """Its standard uncertainty by the coefficients of the drives."""
    forces: Mapping[str, float]
    """Force of each drive on the stage [N/K]; negative where its preload falls."""

    __repr__ = short_repr


def thermal_drift(
    stage: Stage, system: MechanicalSystem, bench: Bench | None = None, *, change: float = 1.0
) -> ThermalDrift:
    r"""Return the drift by a uniform change of temperature, with the drives on their seats.

    .. math::
        K v = \sum_i d_i F_i + \frac{\alpha_p - \alpha_b}{\alpha_p} \Delta T\, t, \quad
        d_i^T v + c_i(F_i) = [(\alpha_i - \alpha_b) L_i
        + (\alpha_p - \alpha_b)(P_i - L_i)] \Delta T, \quad
        y = p^T v + (\alpha_b - \alpha_h) L_h \Delta T

    v is relative to the base, which expands freely, equally in all directions (a similarity); t is
    the load of the plate per kelvin on a base that does not expand. A drive of length L expands
    between its points, whose distance is P: what of it lies beyond them, such as a screw in its
    thread, expands against the plate. Coefficients are those of plate p, base b, drives i and
    sensor holder h.

    Parameters
    ----------
    stage : Stage
        The stage.
    system : MechanicalSystem
        A model of it with a compliant frame (supports "elastic").
    bench : Bench, optional
        Base and sensor holder; those of the stage where not given, or else a base without expansion
        that the sensors are fixed to.
    change : float
        Change of temperature over which the drift is a secant, other than 0 [K]; it matters where
        drives are on balls or rough flats.

    Returns
    -------
    ThermalDrift
        The drift per kelvin.

    Raises
    ------
    ModelError
        The model does not expand, its supports are rigid, or a drive gives no coefficient.

    Notes
    -----
    Exact for the linear model: where all coefficients are equal the drift is 0. Coefficients of
    several drives are taken to err independently. The holder acts on probes against the ground.
    Validity: small changes about 20 degC in equilibrium, bolts that do not slip, and no effect of
    temperature on the displacement of a stack per volt.
    """
    if why := why_no_drift(stage, system):
        raise ModelError(f"there is no thermal drift with the drives in place: {why}")
    bench = bench or _bench(stage)
    readings, rotations, forces = _per_kelvin(stage, system, bench, change)
    changed = [
        _per_kelvin(_with_expansion(stage, drive), system, bench, change)
        for drive in stage.drives
        if drive.thermal_expansion_uncertainty
    ]

    def uncertainty(of: Mapping[str, float], which: int) -> dict[str, float]:
        return {
            name: math.hypot(*(other[which][name] - value for other in changed))
            for name, value in of.items()
        }

    return ThermalDrift(
        readings=readings,
        readings_uncertainty=uncertainty(readings, 0),
        rotations=rotations,
        rotations_uncertainty=uncertainty(rotations, 1),
        forces=forces,
    )


def _with_expansion(stage: Stage, drive: Drive) -> Stage:
    """Return the stage with a drive whose coefficient is larger by its standard uncertainty."""
    larger = (drive.thermal_expansion or 0.0) + (drive.thermal_expansion_uncertainty or 0.0)
    other = replace(drive, thermal_expansion=larger)
    return replace(stage, drives=tuple(other if d is drive else d for d in stage.drives))


def _per_kelvin(
    stage: Stage, system: MechanicalSystem, bench: Bench, change: float
) -> tuple[dict[str, float], dict[str, float], dict[str, float]]:
    """Return the readings [m/K], the rotations of bodies [rad/K] and the forces [N/K]."""
    state = _state(stage, system, bench, change)
    holder = (bench.base - (bench.holder or 0.0)) * (bench.holder_length or 0.0)
    grounded = {p.name for p in stage.probes if p.relative_to is None and p.unit == "m"}
    return (
        {
            name: reading / change + (holder if name in grounded else 0.0)
            for name, reading in state.static.readings.items()
        },
        {name: motion[2] / change for name, motion in state.static.body_motion.items()},
        {name: drive.force / change for name, drive in state.drives.items()},
    )


def _state(stage: Stage, system: MechanicalSystem, bench: Bench, change: float) -> SeatedState:
    """Return the equilibrium relative to the expanded base after a change of temperature [K]."""
    plate = stage.material.thermal_expansion or 0.0
    excess = (plate - bench.base) * change
    free = {}
    for drive in stage.drives:
        if isinstance(drive, Force):
            continue
        distance, length = drive_lengths(drive)
        alone = ((drive.thermal_expansion or 0.0) - bench.base) * change
        free[drive.name] = alone * length + excess * (distance - length)
    load = excess / plate * system.load("temperature").vector
    return static_drives(stage, system, free, load=load)


def drive_lengths(drive: Drive) -> tuple[float, float]:
    """Return the distance of the points of a drive along it, and its length [m]."""
    (x, y), (u, v) = drive.at
    c, s = math.cos(drive.direction), math.sin(drive.direction)
    distance = (x - u) * c + (y - v) * s
    return distance, distance if drive.length is None else drive.length


def _bench(stage: Stage) -> Bench:
    """Return the bench of a stage; a base without expansion where it has none."""
    return stage.bench or Bench(base=0.0)


def has_bench(stage: Stage) -> bool:
    """Return whether a stage has a bench, or a drive with a coefficient of expansion."""
    return stage.bench is not None or any(d.thermal_expansion is not None for d in stage.drives)


def why_no_drift(stage: Stage, system: MechanicalSystem) -> str:
    """Return why a model gives no drift with the drives in place; empty where it does."""
    if not stage.material.thermal_expansion:
        return (
            f"the material '{stage.material.name}' gives no thermal_expansion other than 0: add "
            "it to the material"
        )
    unlike = {stage.material_of(b).thermal_expansion for b in stage.bodies}
    if unlike != {stage.material.thermal_expansion}:
        return (
            "its bodies expand differently, and the base expands against all of them: the plate "
            "must be of one thermal_expansion"
        )
    if not any(load.name == "temperature" for load in system.loads):
        return (
            f"the {system.model} model does not expand: choose superelement, plane, "
            "superelement-3d or solid, with supports elastic"
        )
    drives = [d for d in stage.drives if not isinstance(d, Force)]
    if unknown := [d.name for d in drives if d.thermal_expansion is None]:
        return (
            f"thermal_expansion of the drive '{unknown[0]}' is not given: add it, such as "
            "thermal_expansion: 11.5e-6 1/K for a steel screw"
        )
    fixed = {body.name for body in stage.bodies if body.fixed}
    if system.settings.get("supports") == "rigid" and any(
        fixed & {d.pushes, d.reacts} for d in drives
    ):
        return (
            "with supports rigid the face that a drive reacts on would not move as the frame "
            "expands: choose supports elastic (--supports elastic)"
        )
    return ""


def thermal_notes(stage: Stage, system: MechanicalSystem) -> Iterator[str]:
    """Yield why a drift with the drives in place is missing, and which preloads are lost."""
    if not has_bench(stage):
        return
    if why := why_no_drift(stage, system):
        yield f"Thermal drift with the drives in place is omitted: {why}."
        return
    bench = _bench(stage)
    for sign in (1.0, -1.0):
        largest = sign * (bench.temperature_change or 0.0)
        for drive in stage.drives:
            if not largest or not _is_open(stage, system, bench, drive.name, largest):
                continue
            from scipy.optimize import bisect

            lifts: Any = bisect(
                lambda change, name=drive.name: (
                    1.0 if _is_open(stage, system, bench, name, change) else -1.0
                ),
                0.0,
                largest,
                xtol=1e-6 * abs(largest),
            )
            preload = drive.preload.force if drive.preload else 0.0
            yield (
                f"The drive '{drive.name}' lifts off within the change of temperature of the "
                f"bench, ±{abs(largest):g} K: its preload of {number(preload, 3)} N is gone "
                f"{number(abs(lifts), 2)} K {'above' if lifts > 0.0 else 'below'} that of assembly."
            )


def _is_open(
    stage: Stage, system: MechanicalSystem, bench: Bench, drive: str, change: float
) -> bool:
    drives = _state(stage, system, bench, change).drives
    return drive in drives and drives[drive].is_open


def drift_rows(
    stage: Stage, system: MechanicalSystem, axis: str, probe: str
) -> Iterator[tuple[str, float, str, float | None]]:
    """Yield quantity, value, note and uncertainty of the drift of an axis, if the model has it."""
    if not has_bench(stage) or why_no_drift(stage, system):
        return
    drift, port = thermal_drift(stage, system), system.probe(probe)
    note = _note(stage, drift, stage.axis(axis).moved_by)
    if port.unit == "m":
        u = drift.readings_uncertainty[probe]
        yield "thermal_drift_in_place", drift.readings[probe], note, u or None
        note = f"of body '{port.body}'"
    u = drift.rotations_uncertainty[port.body]
    yield "thermal_rotation_in_place", drift.rotations[port.body], note, u or None


def _note(stage: Stage, drift: ThermalDrift, drives: tuple[str, ...]) -> str:
    """Return the conditions of a drift: bench, coefficients, and forces of the drives."""
    bench = _bench(stage)
    parts = [
        "uniform temperature change",
        f"base {_micro(bench.base)}",
        f"plate {_micro(stage.material.thermal_expansion or 0.0)}",
    ]
    for drive in stage.drives:
        if drive.thermal_expansion is not None:
            known = drive.thermal_expansion_uncertainty
            interval = f" ± {_micro(known)}" if known else ""
            parts.append(f"drive '{drive.name}' {_micro(drive.thermal_expansion)}{interval}")
    if bench.holder is not None:
        length = f"{1e3 * (bench.holder_length or 0.0):g} mm"
        parts.append(f"sensor holder {_micro(bench.holder)} over {length}")
    forces = (f"'{d}' {number(drift.forces[d], 2)} N/K" for d in drives if d in drift.forces)
    changes = f"; force of drive {', '.join(forces)}" if drift.forces.keys() & set(drives) else ""
    return ", ".join(parts) + changes


def _micro(coefficient: float) -> str:
    return f"{1e6 * coefficient:.3g}e-6/K" if coefficient else "without expansion"
