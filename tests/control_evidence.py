"""What control reaches on the simulated stage, where the true position is known.

The stage is identified through its own signals, by a designed record; nothing of what it is made of
is used. Errors are those of the true position from the reference. Run as a program for a table:
``python tests/control_evidence.py 20``.
"""

import sys
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from flexstage.base.arrays import Array
from flexstage.control import (
    ControlMode,
    Learning,
    LearningSettings,
    ServoDesign,
    Trajectory,
    compensate,
    control_run,
    learn,
    shifted_model,
    sine,
    triangle,
    trimmed_model,
    tune,
)
from flexstage.control.feedforward import conditioning_waveform
from flexstage.control.trajectory import RunTracking, evaluate_run
from flexstage.control.two_degree_of_freedom import ControlRun
from flexstage.hysteresis import DriveModel, DriveState, excitation, identify
from flexstage.instruments.protocol import Waveform
from flexstage.records import Channel, Record
from flexstage.stage.designs import design
from flexstage.virtual.build import virtual_stage
from flexstage.virtual.stage import StageSamples, VirtualStage

RATE_HZ = 10e3
#: Age of a reading when the control compares it.
READING_DELAY = 1.0 / RATE_HZ
#: Where a user would look for the first mode along an axis, from the drawing [Hz]. That of y is at
#: 1850 Hz, where samples at 10 kHz do not tell it well from the delay: it is left unknown.
DRAWN_MODE_HZ = {"x": 820.0}
STROKE = 59.5e-6
MAINS_HZ = 50.0
#: What a motion of minutes keeps away from the low end of what a control may reach [m]: the drive
#: creeps upwards by as much, and its voltage would come to rest at 0 V.
RESERVE = 0.5e-6
#: Periods in which a fast motion under control comes to repeat.
SETTLING = 20


@dataclass(frozen=True, kw_only=True)
class Bench:
    """One simulated stage, identified along one axis."""

    stage: VirtualStage
    axis: str
    model: DriveModel
    tuning: ServoDesign
    middle: float
    reach: tuple[float, float]
    told: list[Array] = field(default_factory=list)

    def ends(self, reserve: float = 0.0) -> tuple[float, float]:
        """59.5 um in the middle of what a control may reach, or all of that where it is less.

        A reserve is kept free above the low end.
        """
        low, high = self.stage.limits[self.axis].position or self.reach
        low += reserve
        half = min(0.5 * STROKE, 0.4999 * (high - low))
        return 0.5 * (low + high) - half, 0.5 * (low + high) + half

    @property
    def number(self) -> int:
        return self.stage.axes.index(self.axis)

    def open_loop(self, voltage: Array) -> StageSamples:
        command = np.zeros((len(self.stage.axes), voltage.size))
        command[self.number] = voltage
        return self._kept(self.stage.run(command, [False] * len(self.stage.axes)))

    def _kept(self, block: StageSamples) -> StageSamples:
        """Remember what the drive was told: a thousand voltages a second are enough for creep."""
        self.told.append(block.command[self.number, :: int(RATE_HZ) // 1000])
        return block

    def state(self) -> DriveState:
        """Return the state of the drive after all voltages since the stage had rested."""
        rest = DriveState(hysteresis=self.model.hysteresis.initial_state())
        return self.model.response(np.concatenate(([0.0], *self.told)), 1e-3, rest)[1]

    def closed_loop(self, target: Array, feedforward: Array | None = None) -> StageSamples:
        command = np.zeros((len(self.stage.axes), target.size))
        command[self.number] = target
        servo = [a == self.axis for a in self.stage.axes]
        added = None
        if feedforward is not None:
            added = np.full(command.shape, np.nan)
            added[self.number] = feedforward
        return self._kept(self.stage.run(command, servo, added))

    def carry_out(self, run: ControlRun) -> StageSamples:
        """Return what happens over all periods of a run."""
        if run.lead_in is not None:
            before = self.open_loop(run.lead_in.values[self.axis])
        else:
            before = self.open_loop(np.zeros(2))
        values = np.tile(run.waveform.values[self.axis], run.cycles)
        if run.mode is ControlMode.FEEDFORWARD:
            return self.open_loop(values)
        self.stage.set_servo_settings(self.axis, run.servo[self.axis])
        # a slow move to where the trajectory begins
        here = float(before.reading[self.number, -1])
        s = np.clip(np.arange(4000) / 3000.0, 0.0, 1.0)
        self.closed_loop(here + (values[0] - here) * s * s * (3.0 - 2.0 * s))
        added = None
        if run.feedforward is not None:
            added = np.tile(run.feedforward.values[self.axis], run.cycles)
        return self.closed_loop(values, added)

    def errors(self, run: ControlRun) -> RunTracking:
        """Compare the true position with the reference."""
        return self.errors_of(run, self.carry_out(run))

    def errors_of(self, run: ControlRun, block: StageSamples) -> RunTracking:
        """Compare the true position of a run that was carried out."""
        got = block.position[self.number]
        return evaluate_run(run.trajectory, self.axis, got, skip=run.settling)


def bench(seed: int, axis: str = "x", **options: object) -> Bench:
    """Identify one axis of a stage, and tune its control."""
    stage = virtual_stage(design("vgtu-piezo"), seed=seed, sample_rate_hz=RATE_HZ, **options)  # type: ignore[arg-type]
    number = stage.axes.index(axis)
    limits = stage.limits[axis]
    assert limits.voltage is not None
    made = excitation(
        limits.voltage,
        sample_rate=RATE_HZ,
        rates=(1.0, 50.0),
        frequency=DRAWN_MODE_HZ.get(axis),
        amplifier={"slew": limits.slew},
        hold_time=5.0,
    )
    command = np.zeros((len(stage.axes), made.voltage.size))
    command[number] = made.voltage
    block = stage.run(command, [False] * len(stage.axes))
    record = Record(
        channels=(
            Channel(name="voltage", values=made.voltage, unit="V"),
            Channel(name=axis, values=block.reading[number], unit="m"),
        ),
        time=made.time,
    )
    model = identify(record, "voltage", axis, model=("preisach",)).model
    own = Bench(
        stage=stage,
        axis=axis,
        model=model,
        tuning=tune(model, sample_rate_hz=RATE_HZ),
        middle=0.0,
        reach=(0.0, 0.0),
        told=[made.voltage[:: int(RATE_HZ) // 1000]],
    )
    # the stroke is that of cycles at 1 Hz: what a hold or a fast cycle adds to it is not to be had
    cycles = conditioning_waveform({axis: limits.voltage}, sample_rate_hz=RATE_HZ)
    turned = own.open_loop(cycles.values[axis]).reading[own.number]
    last = turned[int(2.25 * RATE_HZ) : int(3.25 * RATE_HZ)]
    ends = float(last.min()), float(last.max())
    return replace(own, reach=ends, middle=0.5 * (ends[0] + ends[1]))


def slow_reference(own: Bench) -> Trajectory:
    """A cosine at 1 Hz over 99 % of the stroke."""
    half = 0.495 * (own.reach[1] - own.reach[0])
    return sine(own.axis, own.middle - half, own.middle + half, 1.0, sample_rate_hz=RATE_HZ)


def feedforward_figures(own: Bench) -> dict[str, float]:
    """Loop width and tracking at 1 Hz, open loop and by the inverse."""
    wanted = slow_reference(own)
    axis, models = own.axis, {own.axis: own.model}
    limits = {axis: own.stage.limits[axis]}
    low, high = limits[axis].voltage or (0.0, 0.0)
    unit = (wanted.positions[axis] - own.middle) / (own.reach[1] - own.reach[0])
    straight = np.tile(0.5 * (low + high) + unit * (high - low), 5)
    cycles = conditioning_waveform({axis: (low, high)}, sample_rate_hz=RATE_HZ)
    own.open_loop(cycles.values[axis])
    opened = evaluate_run(
        wanted, axis, own.open_loop(straight).position[own.number], skip=2, free_offset=True
    )
    own.open_loop(np.zeros(2 * int(RATE_HZ)))
    blind = control_run("feedforward", wanted, periods=3, models=models, limits=limits)
    plain = compensate(models, wanted, periods=blind.periods, limits=limits)
    after = {axis: own.state()}
    known = compensate(models, wanted, periods=blind.periods, limits=limits, after=after)
    made = own.errors(replace(blind, waveform=known.voltage, lead_in=known.lead_in))
    assert blind.lead_in is not None
    lead_in = blind.lead_in.values[axis]
    own.open_loop(lead_in)
    zero = float(own.open_loop(np.full(200, lead_in[-1])).reading[own.number].mean())
    moved = {axis: shifted_model(own.model, zero - plain.predicted[axis])}
    zeroed = own.errors(control_run("feedforward", wanted, periods=3, models=moved, limits=limits))
    size = 100.0 / float(np.ptp(wanted.positions[axis]))
    return {
        "open loop, loop width [um]": 1e6 * opened.total.loop_width,
        "feedforward, loop width [um]": 1e6 * made.total.loop_width,
        "feedforward, reduction [%]": made.reduction_percent(opened),
        "feedforward, tracking [% rms]": size * made.total.rms,
        "feedforward from a zero that was read, tracking [% rms]": size * zeroed.total.rms,
    }


def feedback_figures(own: Bench) -> dict[str, float]:
    """Errors with feedforward and feedback, on a slow triangle and a fast sine."""
    low, high = own.ends()
    slow = triangle(own.axis, low, high, 1.0, sample_rate_hz=RATE_HZ, turn_time=0.05)
    fast = sine(own.axis, low, high, 50.0, sample_rate_hz=RATE_HZ)
    limits = {own.axis: own.stage.limits[own.axis]}
    found: dict[str, float] = {}

    def error(
        mode: ControlMode, wanted: Trajectory, model: DriveModel, tuning: ServoDesign
    ) -> float:
        run = control_run(
            mode, wanted, periods=3 if wanted is slow else 50, models={own.axis: model},
            servo={own.axis: tuning.settings}, reading_delay=READING_DELAY, limits=limits,
        )  # fmt: skip
        block = own.carry_out(run)
        if mode is ControlMode.FEEDFORWARD:
            read.append(block.reading[own.number])
        own.open_loop(np.zeros(2000))
        return 1e9 * own.errors_of(run, block).total.rms

    # a reference that is slow against the mains: the stage need not follow what they add
    read: list[Array] = []
    quiet = tune(own.model, sample_rate_hz=RATE_HZ, mains_hz=MAINS_HZ)
    for mode in ControlMode:
        found[f"1 Hz triangle, {mode.value} [nm rms]"] = error(mode, slow, own.model, quiet)
    found["1 Hz triangle, both without a notch at the mains [nm rms]"] = error(
        ControlMode.BOTH, slow, own.model, own.tuning
    )
    # the first run without control shows what the delay of the model lacks
    found["50 Hz sine, feedforward [nm rms]"] = error(
        ControlMode.FEEDFORWARD, fast, own.model, own.tuning
    )
    trimmed = trimmed_model(own.model, fast, own.axis, read[-1], skip=2)
    for mode in (ControlMode.FEEDBACK, ControlMode.BOTH):
        found[f"50 Hz sine, {mode.value} [nm rms]"] = error(mode, fast, trimmed, own.tuning)
    found["50 Hz sine, both with the delay as identified [nm rms]"] = error(
        ControlMode.BOTH, fast, own.model, own.tuning
    )
    return found


def learning_run(
    own: Bench, trials: int = 5, *, noise_factor: float = 2.5
) -> tuple[Learning, list[float]]:
    """Learn the voltages of a 50 Hz sine under a slow control; return the true errors too [m].

    The control does not follow the mains and holds the mean. Half a period of the mains passes
    between the two halves of a trial: in their mean what the sensor has of 50 Hz is gone.
    """
    low, high = own.ends(RESERVE)
    wanted = sine(own.axis, low, high, 50.0, sample_rate_hz=RATE_HZ)
    limits, models = {own.axis: own.stage.limits[own.axis]}, {own.axis: own.model}
    servo = {own.axis: tune(own.model, sample_rate_hz=RATE_HZ, mains_hz=MAINS_HZ).settings}
    how = LearningSettings(trials=trials, noise_factor=noise_factor)
    half = round(0.5 * RATE_HZ / MAINS_HZ)
    plain = control_run(
        ControlMode.BOTH, wanted, periods=SETTLING + how.periods, settling=0, models=models,
        servo=servo, limits=limits, reading_delay=READING_DELAY,
    )  # fmt: skip
    assert plain.feedforward is not None
    own.carry_out(plain)
    target = plain.waveform.values[own.axis]
    true: list[float] = []

    def run(period: Waveform) -> Record:
        added = period.values[own.axis]
        readings, errors = [], []
        for _ in range(2):
            own.closed_loop(np.full(half, target[0]), np.full(half, added[0]))
            block = own.closed_loop(np.tile(target, plain.cycles), np.tile(added, plain.cycles))
            late = slice(SETTLING * period.size, None)
            readings.append(block.reading[own.number, late])
            made = evaluate_run(wanted, own.axis, block.position[own.number, late])
            errors.append(made.total.rms)
        true.append(float(np.sqrt(np.mean(np.square(errors)))))
        mean = np.mean(readings, axis=0)
        reading = Channel(name=own.axis, values=mean, unit="m")
        return Record(channels=(reading,), time=np.arange(mean.size) / RATE_HZ)

    found = learn(run, wanted, plain.feedforward, models, how, limits=limits, servo=servo)
    return found, true


def open_loop_width(seed: int, rate_hz: float, amplifier: Literal["voltage", "charge"]) -> float:
    """Return the width of the loop of the true position over its stroke, without any control."""
    stage = virtual_stage(design("vgtu-piezo"), seed=seed, amplifier=amplifier)
    low, high = stage.limits["x"].voltage or (0.0, 0.0)
    wanted = sine("x", low, high, rate_hz, sample_rate_hz=RATE_HZ)
    command = np.zeros((len(stage.axes), 3 * wanted.size))
    command[0] = np.tile(wanted.positions["x"], 3)
    got = stage.run(command, [False] * len(stage.axes)).position[0]
    return evaluate_run(wanted, "x", got, skip=2).total.loop_width / float(np.ptp(got))


def figures(seed: int, *, trials: int = 5, axis: str = "x") -> dict[str, float]:
    """Return every figure of one stage."""
    own = bench(seed, axis)
    found = {**feedforward_figures(own), **feedback_figures(own)}
    _, true = learning_run(own)
    found["learning, start [nm rms]"] = 1e9 * true[0]
    found["learning, 1st trial [nm rms]"] = 1e9 * true[1]
    found["learning, 5th trial or the last [nm rms]"] = 1e9 * true[-1]
    # on and on, where nothing but noise is left
    _, true = learning_run(own, trials, noise_factor=0.0)
    found["learning, largest from the 3rd on [nm rms]"] = 1e9 * max(true[3:])
    return found


def main() -> None:
    """Write a table of figures over seeds."""
    every = [figures(seed, trials=50, axis=sys.argv[2]) for seed in range(int(sys.argv[1]))]
    for name in every[0]:
        values = np.array([f[name] for f in every])
        sys.stdout.write(
            f"{name:55s} median {np.median(values):9.3f}   {values.min():9.3f} to "
            f"{values.max():9.3f}\n"
        )


if __name__ == "__main__":
    main()
