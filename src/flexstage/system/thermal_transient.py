"""Thermal drift of a stage in time: bodies and drives as a network of heat."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from flexstage.base.arrays import Array
from flexstage.base.errors import ModelError
from flexstage.base.short_repr import short_repr
from flexstage.files.plain import plain
from flexstage.files.result import Result
from flexstage.quantities.quantity import number
from flexstage.stage.bench import Bench
from flexstage.stage.mass import mass_properties
from flexstage.stage.model import Body, Stage
from flexstage.stage.outline import Circle
from flexstage.system.mechanical import MechanicalSystem
from flexstage.system.seated_drives import contact_forces, seated_drives
from flexstage.system.statics import solve_stiffness
from flexstage.system.thermal import drive_lengths, has_bench, why_no_drift

# A step is followed over this many of the largest time constants, a sine over two periods more.
_TIME_CONSTANTS, _POINTS = 7.0, 400
_POINTS_OF_PERIOD = 48
_SETTLED = 5e-3  # relative change of a drift that is not worth a word
# Usual limit of the Biot number of an isothermal body [1] (F. P. Incropera et al., Fundamentals of
# Heat and Mass Transfer, section 5.1).
_ISOTHERMAL = 0.1
# Time constants differ by less; a longer one is rounding.
_NEVER = 1e-12

_PAIR = np.array([[1.0, -1.0], [-1.0, 1.0]])
# A bar with the temperatures of its ends and its mean, in units of its conductance: the flow into
# both ends and the mean are exact for constant heat along it.
_BAR = np.array([[4.0, 2.0, -6.0], [2.0, 4.0, -6.0], [-6.0, -6.0, 12.0]])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class HeatNetwork:
    r"""Nodes of heat, :math:`C \dot T = -G T + g_b T_{base} + g_a T_{air} + P`."""

    index: Mapping[tuple[str, str], int]
    """Node of each ("body", name) and ("drive", name); a body without node has the temperature of
    the base, a drive without node the mean one of its bodies.
    """
    capacity: Array
    """C, heat capacities [J/K], shape (n,)."""
    conductance: Array
    """G [W/K], shape (n, n)."""
    base: Array
    """Conductance to the base [W/K], shape (n,)."""
    air: Array
    """Conductance to the air [W/K], shape (n,)."""
    power: Array
    """P, constant heat [W], shape (n,)."""
    biot: Mapping[str, float]
    """Biot number of each body with a node: conductance of its notches over that of a bar of its
    area and its longest side.
    """

    __repr__ = short_repr

    def modes(self) -> tuple[Array, Array]:
        """Return the rates [1/s], slowest first, and the temperatures of their modes [K/J^0.5].

        Raises
        ------
        ModelError
            Heat of some node flows nowhere.
        """
        scale = 1.0 / np.sqrt(self.capacity)
        rates, shapes = np.linalg.eigh(scale[:, None] * self.conductance * scale)
        if rates[0] <= _NEVER * rates[-1]:
            raise ModelError(
                "the heat of a body flows nowhere: give the bench a film_coefficient, or join the "
                "body by hinges to a fixed one"
            )
        return rates, scale[:, None] * shapes

    def temperatures(self, bench: Bench, time: Array) -> Array:
        """Return the change of temperature of each node [K], shape (n, k), at times of shape (k,).

        The closed form of each mode, from equilibrium at time 0.
        """
        rates, shapes = self.modes()
        rate = rates[:, None]
        decay = np.exp(-rate * time)
        step = change = -np.expm1(-rate * time) / rate
        if bench.period is not None:
            omega = 2.0 * math.pi / bench.period
            turn = rate * np.sin(omega * time) - omega * np.cos(omega * time)
            change = (turn + omega * decay) / (rate**2 + omega**2)
        around = bench.base_change * self.base + bench.air_change * self.air
        by_power, by_change = ((shapes.T @ heat)[:, None] for heat in (self.power, around))
        return shapes @ (by_power * step + by_change * change)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ThermalTransient(Result):
    """Drift of a stage in time, from equilibrium at time 0, with its drives in place."""

    table_key: ClassVar[str] = "series"

    time: Array
    """Times [s], shape (k,)."""
    readings: Mapping[str, Array]
    """Reading of each probe [m, or rad], shape (k,)."""
    rotations: Mapping[str, Array]
    """Rotation of each body that a probe reads [rad], shape (k,)."""
    forces: Mapping[str, Array]
    """Force of each drive on the stage besides its preload [N], shape (k,)."""
    bodies: Mapping[str, Array]
    """Change of temperature of each body [K], shape (k,)."""
    drives: Mapping[str, Array]
    """Change of temperature of each drive [K], shape (k,)."""
    time_constants: Array
    """Time constants of the network, largest first [s]."""
    biot: Mapping[str, float]
    """Biot number of each body."""

    __repr__ = short_repr

    def data(self) -> dict[str, Any]:
        groups = {
            "reading": self.readings, "rotation": self.rotations, "force": self.forces,
            "temperature": self.bodies, "drive_temperature": self.drives,
        }  # fmt: skip
        series = {f"{key}.{name}": v for key, of in groups.items() for name, v in of.items()}
        return {
            "time_constants": plain(self.time_constants),
            "biot": plain(self.biot),
            "series": plain({"time": self.time} | series),
        }


def heats(stage: Stage) -> bool:
    """Return whether heat flows in a stage: drives heat it, or base or air change."""
    bench = stage.bench
    changes = bench is not None and (bench.air_change or bench.base_change)
    return bool(changes or any(d.heat is not None and d.heat.power for d in stage.drives))


def heat_network(stage: Stage) -> HeatNetwork:
    r"""Return the network of heat of a stage on its bench.

    A body is one node, its mean temperature, with its mass times the specific heat. A hinge joins
    two of them by

    .. math:: \frac{1}{G} = \frac{1}{k w} \left(\int \frac{dx}{h} + \sum \frac{l}{b}\right)

    with conductivity k, width w, height h along the notch, and the way l from the notch to the
    centre of either body in a bar of its area and its longest side, b high. Surfaces, both faces
    and the edges, exchange heat with the air by the film coefficient. A fixed body has the
    temperature of the base, or a conductance to it. A drive with heat is a bar between both bodies,
    heated evenly.

    Raises
    ------
    ModelError
        The stage has no bench, or its material no specific heat or conductivity.

    Notes
    -----
    Validity: the temperature within a body is even, as the Biot numbers tell. At 9 and less the
    platforms of the piezo stage, whose air warms, are as warm as by finite elements within 5 %
    until 300 s, and 8 % when settled. Long leaves lose heat to the air as a part of their bodies.
    Radiation is part of the film coefficient; the air between plate and base conducts nothing.
    """
    if why := _why_no_network(stage):
        raise ModelError(f"there is no flow of heat: {why}")
    bench, material, width = stage.bench or Bench(base=0.0), stage.material, stage.thickness
    conduction = (material.thermal_conductivity or 0.0) * width
    plain = replace(stage, bodies=tuple(replace(b, extra_masses=()) for b in stage.bodies))
    masses, plates = mass_properties(stage), mass_properties(plain)
    longest, section = {}, {}
    for body in stage.bodies:
        longest[body.name] = _longest_side(body)
    for name, bare in mass_properties(replace(plain, hinges=())).items():
        section[name] = bare.mass / (material.density * width * longest[name])
    index: dict[tuple[str, str], int] = {}
    for body in stage.bodies:
        if not body.fixed or bench.mount_conductance is not None:
            index["body", body.name] = len(index)
    for drive in stage.drives:
        if drive.heat is not None:
            index["drive", drive.name] = len(index)
    n = len(index)
    base, air = n, n + 1
    G = np.zeros((n + 2, n + 2))

    def link(nodes: tuple[int, ...], matrix: Array) -> None:
        np.add.at(G, np.ix_(nodes, nodes), matrix)

    def node(body: str) -> int:
        return index.get(("body", body), base)

    necks = np.zeros(n + 2)
    for hinge in stage.hinges:
        x = hinge.profile.samples()
        height = hinge.profile.neck_thickness + hinge.profile.sides * x.depth
        way = lengths = 2.0 * float(np.sum(np.cos(x.angle) * x.ds / height))
        for name in hinge.bodies:
            if ("body", name) in index:
                beyond = math.dist(plates[name].centre, hinge.at) - 0.5 * hinge.profile.length
                way += max(beyond, 0.0) / section[name]
                necks[node(name)] += conduction / lengths
        a, b = hinge.bodies
        link((node(a), node(b)), conduction / way * _PAIR)
    for drive in stage.drives:
        if drive.heat is not None:
            ends = node(drive.pushes), node(drive.reacts), index["drive", drive.name]
            link(ends, drive.heat.conductance * _BAR)
    capacity, power, biot = np.zeros(n), np.zeros(n), {}
    film = bench.film_coefficient or 0.0
    for body in stage.bodies:
        if ("body", body.name) not in index:
            continue
        i = index["body", body.name]
        area = plates[body.name].mass / (material.density * width)
        link((i, air), film * (2.0 * area + width * _edges(body)) * _PAIR)
        if body.fixed:
            link((i, base), (bench.mount_conductance or 0.0) * _PAIR)
        capacity[i] = masses[body.name].mass * (material.specific_heat or 0.0)
        along = conduction * section[body.name] / longest[body.name]
        biot[body.name] = float(necks[i]) / along
    for drive in stage.drives:
        if drive.heat is not None:
            i = index["drive", drive.name]
            capacity[i], power[i] = drive.heat.capacity, drive.heat.power or 0.0
            link((i, air), film * drive.heat.surface * _PAIR)
    return HeatNetwork(
        index=index,
        capacity=capacity,
        conductance=G[:n, :n],
        base=-G[:n, base],
        air=-G[:n, air],
        power=power,
        biot=biot,
    )


def _edges(body: Body) -> float:
    """Return the length of outline and holes of a body, without mounting holes [m]."""
    total = 0.0
    for shape in (body.outline, *body.holes):
        points = (shape.loop() if isinstance(shape, Circle) else shape).polyline()
        total += _sides(points).sum()
    return float(total)


def _longest_side(body: Body) -> float:
    """Return the longest side of the smallest rectangle around a body [m]."""
    from shapely import MultiPoint, get_coordinates, minimum_rotated_rectangle

    around = minimum_rotated_rectangle(MultiPoint(body.outline.polyline()))
    return float(_sides(get_coordinates(around)[:-1]).max())


def _sides(points: Array) -> Array:
    return np.hypot(*(points - np.roll(points, 1, axis=0)).T)


def thermal_transient(
    stage: Stage, system: MechanicalSystem, time: ArrayLike | None = None
) -> ThermalTransient:
    r"""Return the drift in time by the heat of drives, and by changes of base and air.

    .. math::
        K v = \sum_b (T_b - \tfrac{\alpha_b}{\alpha_p} T_0)\, t_b + \sum_i d_i F_i, \quad
        d_i^T v + c_i(F_i) = \alpha_i L_i T_i + \alpha_p (P_i - L_i) T_r - \alpha_b P_i T_0

    with the temperatures of `HeatNetwork` of bodies, of drives i and of the bodies r that they
    react on, T_0 of the base, and the load t_b of a body per kelvin; the rest is as in
    `thermal_drift`, which it equals where all temperatures are equal.

    Parameters
    ----------
    stage : Stage
        The stage; its bench and its drives say what changes.
    system : MechanicalSystem
        A finite-element model of this stage with a compliant frame (supports "elastic").
    time : array_like, optional
        Times [s], shape (k,); where not given, until all is settled, or periodic.

    Returns
    -------
    ThermalTransient
        The drift; temperatures are exact for the network at each time.

    Raises
    ------
    ModelError
        Nothing changes, or a coefficient of stage or model is missing.

    Notes
    -----
    The sensor holder has the temperature of the base. Validity: as `heat_network` and
    `thermal_drift`; motion follows the temperatures at once.
    """
    if why := why_no_transient(stage, system):
        raise ModelError(f"there is no thermal drift in time: {why}")
    bench = stage.bench or Bench(base=0.0)
    network = heat_network(stage)
    rates, _ = network.modes()
    t = _times(rates, bench) if time is None else np.atleast_1d(np.asarray(time, dtype=np.float64))
    if np.any(t < 0.0):
        raise ModelError(f"all changes begin at 0 s, got a time of {t.min():g} s: give later ones")
    nodes = network.temperatures(bench, t)
    cycle = 1.0 if bench.period is None else np.sin(2.0 * math.pi * t / bench.period)
    base = bench.base_change * cycle * np.ones_like(t)
    bodies = {
        b.name: nodes[network.index["body", b.name]] if ("body", b.name) in network.index else base
        for b in stage.bodies
    }
    warm = {
        d.name: nodes[network.index["drive", d.name]]
        if d.heat is not None
        else 0.5 * (bodies[d.pushes] + bodies[d.reacts])
        for d in stage.drives
    }
    plate = stage.material.thermal_expansion or 0.0
    excess = np.array([bodies[b.name] for b in system.bodies]) - bench.base / plate * base
    loads = np.array([b.thermal for b in system.bodies]).T
    drives, vectors, K = seated_drives(stage, system)
    shapes, _ = solve_stiffness(K, np.column_stack((vectors, loads)), np.zeros((len(K), 0)))
    pushed, expanded = shapes[:, : len(drives)], shapes[:, len(drives) :] @ excess
    free = np.zeros((len(drives), t.size))
    for i, drive in enumerate(drives):
        distance, length = drive_lengths(drive)
        rest = plate * (distance - length) * bodies[drive.reacts] - bench.base * distance * base
        free[i] = (drive.thermal_expansion or 0.0) * length * warm[drive.name] + rest
    free -= vectors.T @ expanded
    forces = np.array([contact_forces(drives, vectors.T @ pushed, w) for w in free.T]).T
    q = pushed @ forces + expanded if drives else expanded
    holder = (bench.base - (bench.holder or 0.0)) * (bench.holder_length or 0.0) * base
    readings, rotations = {}, {}
    for probe in stage.probes:
        grounded = probe.relative_to is None and probe.unit == "m"
        readings[probe.name] = system.probe(probe.name).vector @ q + (holder if grounded else 0.0)
        rotations[probe.body] = system.body(probe.body).matrix[2] @ q
    return ThermalTransient(
        time=t,
        readings=readings,
        rotations=rotations,
        forces={d.name: f for d, f in zip(drives, forces, strict=False)},
        bodies=bodies,
        drives=warm,
        time_constants=1.0 / rates,
        biot=network.biot,
    )


def _times(rates: Array, bench: Bench) -> Array:
    """Return times until all is settled, close where the fastest modes move."""
    end = _TIME_CONSTANTS / float(rates[0])
    if bench.period is None:
        first = min(0.1 / float(rates[-1]), 1e-3 * end)
        return np.concatenate(([0.0], np.geomspace(first, end, _POINTS)))
    # until it is periodic, and two periods of that
    begin = math.ceil(end / bench.period) * bench.period
    cycles = begin + bench.period * np.arange(2 * _POINTS_OF_PERIOD + 1) / _POINTS_OF_PERIOD
    return np.concatenate((np.linspace(0.0, begin, _POINTS, endpoint=False), cycles))


def _why_no_network(stage: Stage) -> str:
    if stage.bench is None:
        return "the stage has no bench: add 'bench', with base, film_coefficient and what changes"
    for name in ("specific_heat", "thermal_conductivity"):
        if not getattr(stage.material, name):
            return f"the material '{stage.material.name}' gives no {name}: add it to the material"
    other = [b.name for b in stage.bodies if stage.material_of(b) != stage.material]
    if other:
        return (
            f"the body '{other[0]}' is of another material than the plate, and the network takes "
            "one specific heat and conductivity: remove its material"
        )
    return ""


def why_no_transient(stage: Stage, system: MechanicalSystem) -> str:
    """Return why a model gives no drift in time; empty where it does."""
    if not heats(stage):
        return (
            "nothing changes: give the bench air_change or base_change, or a drive heat with power"
        )
    if why := _why_no_network(stage) or why_no_drift(stage, system):
        return why
    if any(body.thermal is None for body in system.bodies):
        return "the model is one of a stage without them: make it of the stage with heat and bench"
    return ""


def transient_notes(stage: Stage, system: MechanicalSystem) -> Iterator[str]:
    """Yield why a drift in time is missing, or which body is far from isothermal."""
    if not heats(stage):
        for drive in stage.drives:
            if drive.heat is not None and not drive.heat.power:
                yield (
                    f"Thermal drift in time is omitted: the heat of drive '{drive.name}' has no "
                    "power: give power, or for a stack --rate in Hz and --loss-factor."
                )
        return
    if why := why_no_transient(stage, system):
        # said of the drift with the drives in place already
        if not has_bench(stage) or why != why_no_drift(stage, system):
            yield f"Thermal drift in time is omitted: {why}."
        return
    biot = heat_network(stage).biot
    worst = max(biot, key=lambda body: biot[body])
    if biot[worst] > _ISOTHERMAL:
        yield (
            "The thermal drift in time takes one temperature for each body, which needs Biot "
            f"numbers below {_ISOTHERMAL:g}: that of '{worst}' is {number(biot[worst], 2)} "
            "(conductance of its notches over that along it)."
        )


def transient_rows(
    stage: Stage, system: MechanicalSystem, probe: str
) -> Iterator[tuple[str, float, str]]:
    """Yield quantity, value and note of the drift of a probe in time, if the model has it."""
    if why_no_transient(stage, system):
        return
    result, port = thermal_transient(stage, system), system.probe(probe)
    conditions, bench = _conditions(stage), stage.bench
    period = None if bench is None else bench.period
    if port.unit == "m":
        reading = result.readings[probe]
        yield "drift_in_time", *_largest(result.time, reading, conditions, period)
        conditions = f"of body '{port.body}', {conditions}"
    rotation = result.rotations[port.body]
    yield "rotation_in_time", *_largest(result.time, rotation, conditions, period)


def time_constant_row(stage: Stage, system: MechanicalSystem) -> Iterator[tuple[str, float, str]]:
    """Yield quantity, value and note of the largest thermal time constant, if the model has it."""
    if not why_no_transient(stage, system):
        rates, _ = heat_network(stage).modes()
        yield "thermal_time_constant", 1.0 / float(rates[0]), "slowest of all bodies and drives"


def _largest(
    time: Array, values: Array, conditions: str, period: float | None
) -> tuple[float, str]:
    """Return the largest value, by magnitude, and its note; that of a sine in its last period."""
    if period is not None:
        last = values[time >= time[-1] - period]
        return float(last[np.argmax(np.abs(last))]), f"when periodic; {conditions}"
    at = int(np.argmax(np.abs(values)))
    end = number(time[-1] / 60.0, 3)
    when = f"after {end} min"
    left = float(values[-1] / (values[at] or 1.0))
    if left < 1.0 - _SETTLED:
        share = number(100.0 * left, 2)
        when = f"at {number(time[at] / 60.0, 3)} min; {share} % of it after {end} min"
    return float(values[at]), f"{when}; {conditions}"


def _conditions(stage: Stage) -> str:
    bench = stage.bench or Bench(base=0.0)
    powers = ((d.name, d.heat.power) for d in stage.drives if d.heat is not None and d.heat.power)
    parts = [f"{number(power, 3)} W in drive '{name}'" for name, power in powers]
    kind = "step" if bench.period is None else f"period of {number(bench.period / 60.0, 3)} min"
    changes = (("air", bench.air_change), ("base", bench.base_change))
    parts += [f"{name} {change:+g} K ({kind})" for name, change in changes if change]
    if bench.film_coefficient is not None:
        parts.append(f"film {bench.film_coefficient:g} W/(m² K)")
    return ", ".join(parts)
