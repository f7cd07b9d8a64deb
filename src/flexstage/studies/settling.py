"""Settling of a move on a simulated piezo stage: predicted, over the tolerance, and simulated."""

import json
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from scipy.optimize import brentq

from flexstage.base import progress
from flexstage.base.arrays import Array
from flexstage.base.errors import LimitError, ModelError
from flexstage.control.design import ServoDesign, tune_plant
from flexstage.control.loop_plant import LoopPlant, loop_plant
from flexstage.control.moves import (
    MovePlant,
    MoveResponse,
    Shaper,
    VoltageLimits,
    decay_time,
    fastest_ramp,
    jerk_limited,
    minimum_time,
    scattered_plants,
    shaped,
    shaper,
)
from flexstage.files.plain import picked
from flexstage.files.result import Result
from flexstage.hysteresis import DriveModel, Lag, StageModes, ValidityRange
from flexstage.hysteresis.chain.creep import Creep
from flexstage.hysteresis.dynamic_model import ModelDrive
from flexstage.hysteresis.requests import ModeTolerance
from flexstage.records import Channel, Record
from flexstage.records.record import SIMULATED
from flexstage.stage import PiezoStack, Stage
from flexstage.studies.requests import SettleRequest
from flexstage.system.servo import ServoSettings
from flexstage.virtual.build import virtual_stage
from flexstage.virtual.piezo_loop import amplifier_of
from flexstage.virtual.piezo_stage import PiezoStage, stack_of

#: Modes that move the probe by less than this share of the drive's motion are omitted.
_WORTH = 1e-5
#: Quantile of settling over the tolerance.
QUANTILE = 0.95
#: Samples of a loop from a reading to the voltage that corrects it, and to its use.
_LOOP_DELAY, _READING_DELAY = 2.0, 1.0
#: Time before a simulated move: a full cycle, the way to the start, rest, rest under control [s].
_CYCLE, _WAY, _REST = 0.5, 0.25, 0.5
#: Feedback without added voltages, as a kind of move.
ALONE = "feedback alone"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SettlingTime:
    """Settling of a move in one mode of control."""

    predicted: float
    """Settling time at the values of the plant [s]; inf for none within the computed time."""
    quantile: float
    """Time that 95 % of the plants within the tolerance do not exceed [s]; inf likewise."""
    simulated: float
    """Settling time on the simulated stage, at its samples [s]; inf likewise."""
    motion: MoveResponse
    """The predicted motion."""
    simulation: MoveResponse
    """The simulated motion."""
    voltage_rate: float
    """Largest rate of the simulated voltage at the stack, over a sample [V/s]."""

    def data(self) -> dict[str, float | None]:
        """Return the times [s] as plain data; None for none."""
        return picked(self, "predicted", f"quantile_{QUANTILE * 100:.0f}=quantile", "simulated")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SettledMove:
    """One kind of move."""

    kind: str
    """Kind: step, jerk-limited, zv, zvd, ei, minimum-time, robust minimum-time, feedback alone."""
    voltage: Array
    """Voltages from the start [V], shape (n,), without the hysteresis; none for feedback alone."""
    duration: float
    """Duration of the command [s]."""
    peak: float
    """Largest position of the predicted motion, in open loop where there is one [m]."""
    current: float | None
    """Largest current of the simulated stack, over a sample [A]; None if its capacitance is
    unknown.
    """
    open_loop: SettlingTime | None
    """Settling in open loop, without creep; None for feedback alone."""
    feedback: SettlingTime
    """Settling under control, with creep."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SettlingStudy(Result):
    """Settling of a move on a simulated stage."""

    table_key: ClassVar[str] = "moves"

    stage: str
    """Name of the stage."""
    axis: str
    """The axis."""
    distance: float
    """Distance [m]."""
    band: float
    """Band about the end [m]."""
    plant: LoopPlant
    """The plant."""
    control: ServoDesign
    """The control."""
    shapers: tuple[tuple[float, float], ...]
    """Frequency [Hz] and damping ratio of the shaped modes."""
    tolerance: ModeTolerance
    """Tolerance of the plant."""
    start: float
    """Voltage at the start [V]."""
    moves: tuple[SettledMove, ...]
    """Results by kind of move."""
    notes: tuple[str, ...] = field(default=())
    """Limits and assumptions."""

    def data(self) -> dict[str, Any]:
        return {
            "kind": "settling",
            **picked(self, "stage", "axis", "distance", "band"),
            "modes": [{"frequency_hz": f, "damping_ratio": z} for f, z in self.shapers],
            "bandwidth_hz": self.control.worst.bandwidth_hz,
            "moves": [
                {
                    **picked(move, "kind", "duration", "peak", "current"),
                    "open_loop": None if move.open_loop is None else move.open_loop.data(),
                    "feedback": move.feedback.data(),
                }
                for move in self.moves
            ],
            "notes": list(self.notes),
        }

    def record(self, kind: str) -> Record:
        """Return the voltages and the predicted position of a move, for a controller."""
        (move,) = (m for m in self.moves if m.kind == kind)
        if move.open_loop is None:
            raise ModelError(f"{kind} has no voltages of its own: choose another move")
        rate = self.plant.sample_rate_hz
        # at rest before the move and after it
        rest = round(0.05 * rate)
        way = np.concatenate((np.zeros(rest), move.voltage, np.full(rest, move.voltage[-1])))
        time = np.arange(way.size) / rate
        reached = np.interp(time - rest / rate, move.open_loop.motion.time,
                            move.open_loop.motion.position)  # fmt: skip
        return Record(
            channels=(
                Channel(name="command", values=self.start + way, unit="V"),
                Channel(name="predicted", values=reached, unit="m"),
            ),
            time=time,
            source=f"{kind} move of {self.stage}, axis {self.axis}",
            attributes={SIMULATED: f"model of {self.stage}, axis {self.axis}"},
        )


def settle(stage: Stage, request: SettleRequest, axis: str | None = None) -> SettlingStudy:
    """Return the settling of every kind of move, in open loop and under control.

    The plant, its control by `tune_plant`, and the simulation are those of one virtual stage
    without scatter. The simulated voltages pass the exact inverse of its hysteresis.

    Parameters
    ----------
    stage : Stage
        A stage with piezo stacks.
    request : SettleRequest
        The move, its band, limits and tolerance.
    axis : str, optional
        The axis (default: the first).

    Returns
    -------
    SettlingStudy
        The times.

    Raises
    ------
    ModelError
        The stage has no piezo stacks, a mode without damping, or an axis of rotation.
    LimitError
        The move is larger than the limits allow.

    Notes
    -----
    Validity: a linear plant about the middle of the range; simulated times have the resolution of
    a sample.
    """
    if not stage.axes:
        raise ModelError(f"stage '{stage.name}' has no axis to move: add one")
    moved = stage.axis(axis or stage.axes[0].name)
    named = moved.name
    if (unit := stage.probe(moved.probe).unit) != "m":
        raise ModelError(
            f"the probe of axis '{named}' reads {unit}: a move is a distance, so choose an axis "
            "whose probe reads a displacement"
        )
    twin = virtual_stage(
        stage, model=request.model, sample_rate_hz=request.servo_rate, quiet=True, scatter=False
    )
    if not isinstance(twin, PiezoStage):
        raise ModelError(
            f"axis '{named}' of {stage.name} is driven by a screw: settling is computed for piezo "
            "stacks"
        )
    progress.update("control", 0.05)
    bench = _Bench(stage, twin, named, request)
    moves = tuple(bench.settled(kind) for kind in bench.kinds())
    return SettlingStudy(
        request=request,
        stage=stage.name,
        axis=named,
        distance=request.move,
        band=request.band,
        plant=bench.plant,
        control=bench.control,
        shapers=tuple((s.frequency_hz, s.damping_ratio) for s in bench.shapers("zv")),
        tolerance=bench.tolerance,
        start=bench.start,
        moves=moves,
        notes=bench.notes(moves),
    )


def move_plant(twin: PiezoStage, axis: str) -> LoopPlant:
    """Return the plant of an axis of a virtual stage: voltage [V] to position [m]."""
    part = twin.parts[twin.axes.index(axis)]
    model, drive = twin.model, twin.model.drive(part.drive)
    static = model.static_gain(part.drive, part.probe)
    share = drive.modal_gain * model.probe_shapes[model.row(part.probe)] / static
    significant = np.abs(share) > _WORTH
    voltage = part.limits.voltage or (0.0, 0.0)
    chain = DriveModel(
        hysteresis=stack_of(drive),
        creep=drive.creep,
        modes=StageModes(
            frequency_hz=(model.omega[significant] / (2.0 * np.pi)).tolist(),
            damping_ratio=model.damping_ratio[significant].tolist(),
            share=share[significant].tolist(),
        ),
        lag=Lag(time_constant=amplifier_of(drive).time_constant),
        validity=ValidityRange(
            input_range=voltage, output_range=part.limits.position or (0.0, 0.0),
            rate_range_hz=(1.0, 1.0),
        ),
    )  # fmt: skip
    rate, tau = twin.sample_rate_hz, amplifier_of(drive).time_constant
    # the voltage of the simulation is straight between samples: its mean delay is longer by this
    straight = 0.5 / rate / math.tanh(0.5 / (rate * tau)) - tau
    plant = loop_plant(chain, rate, delay=_LOOP_DELAY / rate + straight)
    low, high = plant.gain_range
    return replace(plant, gain=static * plant.gain, gain_range=(static * low, static * high))


class _Bench:
    """A virtual stage, the plant of its axis, and the predicted and simulated moves."""

    def __init__(self, stage: Stage, twin: PiezoStage, axis: str, request: SettleRequest) -> None:
        self.request, self.axis, self.number = request, axis, twin.axes.index(axis)
        self.distance, self.band = request.move, request.band
        self.plant = move_plant(twin, axis)
        self.creep: Creep | None = twin.model.drive(twin.parts[self.number].drive).creep
        self.modes, self.tolerance = _shaped_modes(self.plant, request)
        low, high = twin.limits[axis].voltage or (0.0, 0.0)
        volts = self.distance / self.plant.gain
        self.start = 0.5 * (low + high - volts)
        if not low <= self.start:
            raise LimitError(
                f"a move of {1e6 * self.distance:.4g} um needs {volts:.4g} V, and the range of "
                f"axis '{axis}' is {low:g} to {high:g} V: make it smaller"
            )
        self.control = tune_plant(self.plant)
        drive = stage.drive_of(axis)
        self.capacitance = request.amplifier.capacitance
        if self.capacitance is None and isinstance(drive, PiezoStack):
            self.capacitance = drive.capacitance
        amplifier = replace(request.amplifier, capacitance=self.capacitance)
        amplifier.require_load()
        slews = (twin.limits[axis].slew, amplifier.largest_rate)
        self.limits = VoltageLimits(
            low=low - self.start,
            high=high - self.start,
            slew=min((s for s in slews if s is not None), default=math.inf),
            acceleration=request.acceleration or _preload_acceleration(stage, twin, axis),
        )
        # without creep, which open loop never settles from
        drives = tuple(replace(d, creep=None) for d in twin.model.drives)
        self.twins = {
            False: PiezoStage(stage=stage, model=replace(twin.model, drives=drives),
                              axes=twin.parts, conditions=twin.conditions),
            True: twin,
        }  # fmt: skip
        self.limited = twin
        if amplifier.largest_rate is not None:
            # the added voltages of other moves keep the limit themselves
            named = twin.parts[self.number].drive
            drives = tuple(
                _slower(d, self.limits.slew) if d.name == named else d for d in twin.model.drives
            )
            self.limited = PiezoStage(
                stage=stage, model=replace(twin.model, drives=drives), axes=twin.parts,
                conditions=twin.conditions,
            )  # fmt: skip
        self._predict()

    def _predict(self) -> None:
        """Compute the responses of the plant and of those within its tolerance."""
        narrow = (1.0 - self.tolerance.frequency) * (1.0 - self.tolerance.damping)
        seconds = decay_time(self.plant, 5.0 * max(self.distance / self.band, 10.0)) / narrow
        if not math.isfinite(seconds):
            raise ModelError("a mode without damping never settles: give the stage its damping")
        self.seconds = max(seconds, 0.2)
        settings = {False: None, True: self.control.settings}
        self.nominal = {on: self._of(self.plant, s) for on, s in settings.items()}
        plants = list(scattered_plants(self.plant, self.tolerance))
        self.scattered = {
            on: [(self._of(plant, s), factor) for plant, factor in plants]
            for on, s in settings.items()
        }

    def _of(self, plant: LoopPlant, settings: ServoSettings | None) -> MovePlant:
        delay = _READING_DELAY / plant.sample_rate_hz
        return MovePlant(plant, settings, reading_delay=delay, seconds=self.seconds)

    def kinds(self) -> Iterator[str]:
        """Yield the kinds of moves, with progress."""
        kinds = (*VOLTAGES, ALONE)
        for k, kind in enumerate(kinds):
            progress.update(kind, 0.2 + 0.8 * k / len(kinds))
            yield kind

    def shapers(self, kind: str) -> list[Shaper]:
        """Return the shapers of a kind, one for each mode."""
        return [shaper(kind, f, zeta) for f, zeta in self.modes]

    def settled(self, kind: str) -> SettledMove:
        """Return the settling of a kind of move."""
        rate = self.plant.sample_rate_hz
        voltage = np.zeros(1) if kind == ALONE else VOLTAGES[kind](self)
        target = np.array([self.distance])
        open_loop = None
        if kind != ALONE:
            target = self.nominal[False].readings(voltage)
            open_loop = self._time(voltage, None)
        feedback = self._time(voltage, target)
        rise = (open_loop or feedback).voltage_rate
        current = None if self.capacitance is None else self.capacitance * rise
        return SettledMove(
            kind=kind,
            voltage=np.zeros(0) if kind == ALONE else voltage,
            duration=voltage.size / rate,
            peak=float((open_loop or feedback).motion.position.max()),
            current=current,
            open_loop=open_loop,
            feedback=feedback,
        )

    def _time(self, voltage: Array, target: Array | None) -> SettlingTime:
        on = target is not None
        drift = self._drift(voltage if voltage.any() else None) if on else None
        motion = self.nominal[on].motion(voltage, target, drift)
        times = [
            plant.motion(factor * voltage if on else voltage, target, drift).settling(self.band)
            for plant, factor in self.scattered[on]
        ]
        simulation, voltage_rate = self._simulated(voltage, target)
        return SettlingTime(
            predicted=motion.settling(self.band),
            quantile=float(np.quantile(times, QUANTILE, method="higher")),
            simulated=simulation.settling(self.band),
            motion=motion,
            simulation=simulation,
            voltage_rate=voltage_rate,
        )

    def _drift(self, voltage: Array | None) -> Array | None:
        """Return the creep of the stage after voltages, or after a step without them [m]."""
        if self.creep is None:
            return None
        size = self.nominal[True].size
        volts = np.array([self.distance / self.plant.gain]) if voltage is None else voltage
        moved = self.plant.gain * np.append(volts, np.full(max(size - volts.size, 0), volts[-1]))
        rest = self.creep.settled(0.0, 1.0 / self.plant.sample_rate_hz)
        return self.creep.simulate(moved, 1.0 / self.plant.sample_rate_hz, rest).values - moved

    def _simulated(self, voltage: Array, target: Array | None) -> tuple[MoveResponse, float]:
        """Return the motion of the simulated stage from rest, and its largest voltage rate."""
        twin = self.twins[target is not None]
        if target is not None and not voltage.any():
            twin = self.limited
        rate, size = twin.sample_rate_hz, round(self.seconds * twin.sample_rate_hz)
        twin.reset()
        low, high = twin.limits[self.axis].voltage or (0.0, 0.0)
        phase = 2.0 * np.pi * np.arange(round(_CYCLE * rate)) / round(_CYCLE * rate)
        before = np.concatenate((
            low + (high - low) * (0.5 - 0.5 * np.cos(phase)),
            np.linspace(low, self.start, round(_WAY * rate)),
            np.full(round(_REST * rate), self.start),
        ))  # fmt: skip
        samples = [self._run(twin, before, None)]
        if target is not None:
            twin.set_servo_settings(self.axis, self.control.settings)
            here = float(samples[0].reading[self.number, -1])
            # the voltages are added from here on: a servo takes their first value as its zero
            start = np.full(round(_REST * rate), self.start) if voltage.any() else None
            samples.append(self._run(twin, np.full(round(_REST * rate), here), True, start))
        rest = float(samples[-1].position[self.number, -1])
        full = None
        if voltage.any():
            past = np.concatenate([s.voltage[self.number] for s in samples])
            full = _extended(self._with_hysteresis(twin, past, voltage), size)
            if target is not None:
                # the integral term compensates the creep
                full += self.start - past[-1]
        if target is None:
            assert full is not None
            moved = self._run(twin, full, None)
        else:
            moved = self._run(twin, rest + _extended(target, size), True, full)
        position = moved.position[self.number] - rest
        end = self.distance if target is not None else float(position[-1])
        rises = np.diff(moved.voltage[self.number])
        motion = MoveResponse(time=np.arange(size) / rate, position=position, end=end)
        return motion, float(np.max(np.abs(rises))) * rate

    def _run(
        self, twin: PiezoStage, command: Array, on: bool | None, added: Array | None = None
    ) -> Any:
        rows = np.zeros((len(twin.axes), command.size))
        rows[self.number] = command
        feedforward = None
        if added is not None:
            feedforward = np.full(rows.shape, np.nan)
            feedforward[self.number] = added
        return twin.run(rows, [bool(on) and a == self.axis for a in twin.axes], feedforward)

    def _with_hysteresis(self, twin: PiezoStage, past: Array, voltage: Array) -> Array:
        """Return the voltages by which the stack does what a linear one does, after its past."""
        drive = twin.model.drive(twin.parts[self.number].drive)
        stack, static = stack_of(drive), self._static(twin)
        share = -math.expm1(-1.0 / (twin.sample_rate_hz * self.plant.time_constant))
        before = stack.simulate(past)
        state, free = before.state, float(before.values[-1])
        low, high = twin.limits[self.axis].voltage or (0.0, 0.0)
        # until the amplifier follows within a millionth
        tail = np.full(math.ceil(14.0 / share), voltage[-1])
        linear, out = 0.0, []
        behind = float(past[-1])
        for v in np.concatenate((voltage, tail)).tolist():
            linear += share * (v - linear)
            target_free = free + self.plant.gain * linear / static

            def error(u: float, state: Array = state, target_free: float = target_free) -> float:
                return float(stack.simulate([u], state).values[0]) - target_free

            if not error(low) <= 0.0 <= error(high):
                raise LimitError(
                    f"the hysteresis of axis '{self.axis}' needs voltages beyond {low:g} to "
                    f"{high:g} V for this move: make it smaller"
                )
            u = float(brentq(error, low, high, xtol=1e-10))
            state = stack.simulate([u], state).state
            out.append(min(max(behind + (u - behind) / share, low), high))
            behind = u
        out[-1] = behind
        return np.array(out)

    def _static(self, twin: PiezoStage) -> float:
        part = twin.parts[self.number]
        return twin.model.static_gain(part.drive, part.probe)

    def notes(self, moves: Sequence[SettledMove]) -> tuple[str, ...]:
        """Return limits and assumptions as sentences."""
        settings, worst, tolerance = self.control.settings, self.control.worst, self.tolerance
        filters = [f"notch at {n.frequency_hz:.4g} Hz" for n in settings.notches]
        filters += [f"low-pass at {settings.lowpass_hz:.4g} Hz"] if settings.lowpass_hz else []
        terms = "proportional and integral" if settings.proportional else "integral"
        limits = f"{self.limits.slew:.4g} V/s behind the amplifier"
        if math.isfinite(self.limits.acceleration):
            limits += f", {self.limits.acceleration:.4g} m/s^2"
        notes = [
            f"95 %: of plants with frequencies within {100.0 * tolerance.frequency:.3g} %, damping "
            f"within {100.0 * tolerance.damping:.3g} %, and under control any slope of the "
            f"hysteresis and an inverse within {100.0 * tolerance.inverse:.3g} %",
            f"control: {terms}, {' and '.join(filters) or 'no filter'}; errors halved up to "
            f"{worst.bandwidth_hz:.3g} Hz, gain margin {worst.gain_margin:.3g}",
            f"commands at {self.plant.sample_rate_hz:g} Hz, at most {limits}",
        ]
        if self.creep is not None:
            drift = self._drift(None)
            assert drift is not None
            last = min(drift.size, round(0.1 * self.plant.sample_rate_hz)) - 1
            notes.append(
                f"open loop is without creep, which moves the stage by {1e9 * drift[last]:.3g} nm "
                f"within {1e3 * (last + 1) / self.plant.sample_rate_hz:.3g} ms; under control it "
                "is included"
            )
        alone = next(m.feedback for m in moves if m.kind == ALONE)
        if alone.voltage_rate > 0.98 * self.limits.slew:
            notes.append(
                f"{ALONE}: the amplifier limits the simulated voltage; its prediction neglects that"
            )
        # the slope of the hysteresis is smaller after a reversal than its mean
        times = [(m.kind, m.open_loop) for m in moves if m.open_loop is not None]
        steep = [kind for kind, t in times if t.voltage_rate > 1.02 * self.limits.slew]
        if steep:
            notes.append(
                f"{', '.join(steep)}: the inverse of the hysteresis needs a steeper voltage than "
                "the limit, and the simulated amplifier may have limited it: give a smaller slew "
                "by --amplifier"
            )
        return tuple(notes)


def _slower(drive: ModelDrive, rate: float) -> ModelDrive:
    """Return a drive whose amplifier is no faster than a rate [V/s]."""
    return replace(drive, amplifier=replace(amplifier_of(drive), slew_limit=rate))


def _extended(signal: Array, size: int) -> Array:
    """Return a signal of a size that holds its last value."""
    return np.append(signal, np.full(max(size - signal.size, 0), signal[-1]))[:size]


def _jerk_limited(bench: _Bench) -> Array:
    """Phases of jerk as long as a period of the first mode do not excite it, without damping."""
    plant, ramp = bench.plant, fastest_ramp(bench.plant, bench.distance, bench.limits)
    way = jerk_limited(
        bench.distance,
        jerk=0.5 * bench.distance * bench.modes[0][0] ** 3,
        speed=plant.gain * float(ramp[0]) * plant.sample_rate_hz,
        acceleration=bench.limits.acceleration,
        sample_rate_hz=plant.sample_rate_hz,
    )
    return way[1:] / plant.gain


def _shaped(kind: str) -> Any:
    def voltages(bench: _Bench) -> Array:
        ramp = fastest_ramp(bench.plant, bench.distance, bench.limits)
        return shaped(ramp, bench.shapers(kind), bench.plant.sample_rate_hz)

    return voltages


def _minimum(*, robust: bool) -> Any:
    def voltages(bench: _Bench) -> Array:
        return minimum_time(
            bench.plant, bench.distance, bench.limits, band=bench.band, robust=robust
        )

    return voltages


#: Voltages of each kind of move.
VOLTAGES: dict[str, Any] = {
    "step": lambda bench: fastest_ramp(bench.plant, bench.distance, bench.limits),
    "jerk-limited": _jerk_limited,
    "zv": _shaped("zv"),
    "zvd": _shaped("zvd"),
    "ei": _shaped("ei"),
    "minimum-time": _minimum(robust=False),
    "robust minimum-time": _minimum(robust=True),
}


def _shaped_modes(
    plant: LoopPlant, request: SettleRequest
) -> tuple[list[tuple[float, float]], ModeTolerance]:
    """Return frequency [Hz] and damping ratio of the shaped modes, and their tolerance."""
    modes = plant.modes
    assert modes is not None
    order = np.argsort(-np.abs(modes.share), kind="stable")[: request.modes]
    rows = [(modes.frequency_hz[i], modes.damping_ratio[i]) for i in order.tolist()]
    if request.modal_fit is None:
        return rows, request.tolerance
    fitted = _fitted_modes(Path(request.modal_fit))
    nearest = [min(fitted, key=lambda mode, f=f: abs(mode[0][0] - f)) for f, _ in rows]
    if len(set(nearest)) < len(nearest):
        raise ModelError(
            f"'{request.modal_fit}' has no mode of its own near each of "
            f"{', '.join(f'{f:.4g} Hz' for f, _ in rows)}: fit more modes, or reduce --modes"
        )
    (frequency, damping), tolerance = nearest[0], request.tolerance
    # the expanded uncertainty, two standard uncertainties
    return [(f[0], zeta[0]) for f, zeta in nearest], replace(
        tolerance,
        frequency=2.0 * frequency[1] / frequency[0],
        damping=min(2.0 * damping[1] / damping[0], 0.9),
    )


def _fitted_modes(path: Path) -> list[tuple[tuple[float, float], tuple[float, float]]]:
    """Return value and standard uncertainty of frequency and damping of the modes of a file."""
    try:
        modes = json.loads(path.read_text(encoding="utf-8"))["modes"]
        pairs = [
            tuple((float(mode[name]["value"]), float(mode[name]["uncertainty"]))
                  for name in ("frequency_hz", "damping_ratio"))
            for mode in modes
        ]  # fmt: skip
    except OSError as error:
        raise ModelError(f"'{path}' cannot be read ({error.strerror or error})") from None
    except (KeyError, TypeError, ValueError):
        pairs = []
    usable = all(
        0.0 < value < math.inf and 0.0 <= uncertainty < math.inf
        for mode in pairs for value, uncertainty in mode
    )  # fmt: skip
    if not pairs or not usable:
        raise ModelError(
            f"'{path}' has no fitted modes with their uncertainty: give the output of "
            "flexstage frf --json"
        )
    return [(f, zeta) for f, zeta in pairs]


def _preload_acceleration(stage: Stage, twin: PiezoStage, axis: str) -> float:
    """Return the acceleration at which the first mode takes the preload off the drive [m/s^2].

    A mode of unit modal mass whose shape is b at the drive and p at the probe needs the force
    ``a / (b p)`` at the drive for an acceleration a of the probe. A free displacement of a drive
    of stiffness k moves the probe by the mode by ``k b p / omega^2``.
    """
    drive = stage.drive_of(axis)
    if drive.preload is None or not isinstance(drive, PiezoStack) or drive.pulls:
        return math.inf
    part = twin.parts[twin.axes.index(axis)]
    moved, row = twin.model.drive(part.drive), twin.model.row(part.probe)
    weights = np.abs(moved.modal_gain * twin.model.probe_shapes[row])
    first = int(np.argmax(weights))
    mass = (moved.stiffness or drive.stiffness) / (weights[first] * twin.model.omega[first] ** 2)
    return drive.preload.force / float(mass)
