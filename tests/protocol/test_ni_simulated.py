"""An NI card with a simulated driver: one clock for inputs and outputs, limits at the drive."""

import threading
from collections.abc import Mapping

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flexstage.base.arrays import Array
from flexstage.base.errors import ControllerError, LimitError, ModelError
from flexstage.instruments.guard import guarded
from flexstage.instruments.ni.acquisition import NiAcquisition
from flexstage.instruments.ni.address import open_address
from flexstage.instruments.ni.setup import DriveOutput, NiSetup, SensorInput
from flexstage.instruments.ni.simulated import SimulatedBackend, _Output
from flexstage.instruments.protocol import (
    Capability,
    Instrument,
    MotionAxis,
    Recorder,
    Signal,
    Waveform,
)
from flexstage.instruments.protocol import WaveGenerator as Generator
from flexstage.instruments.ramp import lead_to
from flexstage.instruments.record_run import record_now, run_waveform
from flexstage.stage.designs import design
from flexstage.stage.limits import AxisLimits

#: Volts at each input for a volt at each output; both drives reach the third sensor.
WIRING = {
    "Dev1/ai3": {"Dev1/ao0": 0.83},
    "Dev1/ai1": {"Dev1/ao1": -0.61},
    "Dev1/ai7": {"Dev1/ao0": 0.05, "Dev1/ao1": 0.11},
}
INPUTS = (
    SensorInput(channel="Dev1/ai3", name="x", gain=7.1e-6, offset=-3e-6),
    SensorInput(channel="Dev1/ai1", name="y", gain=-9.3e-6),
    SensorInput(channel="Dev1/ai7", name="roll", unit="rad", gain=2e-5, voltage_range=(-1.0, 1.0)),
)
OUTPUTS = (
    DriveOutput(channel="Dev1/ao0", axis="x", sensor="x", gain=15.0, offset=0.4),
    DriveOutput(channel="Dev1/ao1", axis="y", sensor="y", gain=12.0, voltage_range=(0.0, 9.0)),
)
LIMITS = {
    "x": AxisLimits(voltage=(-20.0, 120.0), slew=4000.0, safe_voltage=6.0),
    "y": AxisLimits(slew=9000.0),
}
U = Signal(kind="voltage", source="x", name="u", unit="V")
X = Signal(kind="position", source="x", name="x")
ROLL = Signal(kind="channel", source="3", name="roll", unit="rad")


def card(
    rate: float = 10e3,
    *,
    noise: float = 0.0,
    lead_to_safe: bool = True,
    simultaneous: bool = True,
    readable: bool = True,
    standing: dict[str, float] | None = None,
) -> NiAcquisition:
    setup = NiSetup(
        device="Dev1",
        inputs=INPUTS,
        outputs=OUTPUTS,
        output_rate_hz=rate,
        lead_to_safe=lead_to_safe,
    )
    backend = SimulatedBackend(
        WIRING, noise=noise, seed=5, simultaneous=simultaneous, readable=readable, standing=standing
    )
    return NiAcquisition(setup, backend, limits=LIMITS)


def reading(sensor: SensorInput, voltages: dict[str, Array]) -> Array:
    """What a sensor gives for voltages at the drives, written out once more."""
    card_volts = {"Dev1/ao0": (voltages["x"] - 0.4) / 15.0, "Dev1/ao1": voltages["y"] / 12.0}
    v = sum(g * card_volts[c] for c, g in WIRING[sensor.channel].items())
    return sensor.gain * np.clip(v, *sensor.voltage_range) + sensor.offset


def cosine(n: int = 400, rate: float = 1000.0, amplitude: float = 35.0) -> Waveform:
    u = 41.0 - amplitude * np.cos(2.0 * np.pi * np.arange(n) / n)
    return Waveform(values={"x": u, "y": 0.6 * u}, sample_rate_hz=rate, quantity="voltage")


def test_it_is_an_instrument() -> None:
    instrument = card()
    assert isinstance(instrument, Instrument)
    assert isinstance(instrument.axes["y"], MotionAxis)
    assert isinstance(instrument.recorder, Recorder)
    assert isinstance(instrument.waves, Generator)
    assert instrument.identity.simulated
    assert instrument.axes["x"].capabilities == {Capability.OPEN_LOOP}


def test_limits_are_those_at_the_drive() -> None:
    instrument = card()
    # The amplifier of x could give -149.6 to 150.4 V, that of y gives 0 to 108 V.
    assert instrument.axes["x"].limits.voltage == (-20.0, 120.0)
    assert instrument.axes["y"].limits.voltage == (0.0, 108.0)
    for axis, wrong in (("x", 120.1), ("x", -20.1), ("y", 108.1), ("y", -0.1)):
        with pytest.raises(LimitError, match="cannot be sent"):
            instrument.axes[axis].set_voltage(wrong)
        with pytest.raises(LimitError, match="would be sent to"):
            instrument.waves.load(
                Waveform(
                    values={axis: np.array([5.0, wrong])}, sample_rate_hz=9.0, quantity="voltage"
                )
            )
    with pytest.raises(ModelError, match="no position control"):
        instrument.axes["x"].move_to(1e-6)
    with pytest.raises(ModelError, match="no position control"):
        instrument.axes["x"].set_closed_loop(True)
    with pytest.raises(ModelError, match="no position control: give voltages"):
        instrument.waves.load(
            Waveform(values={"x": np.zeros(3)}, sample_rate_hz=9.0, quantity="position")
        )


@pytest.mark.parametrize("cycles", [1, 3])
def test_a_waveform_and_what_it_does_are_in_step(cycles: int) -> None:
    instrument = card()
    wave = cosine()
    record = run_waveform(instrument, wave, [U, X, ROLL], rate_hz=10e3, cycles=cycles)
    n = 4000 * cycles
    assert record.size == n
    k = np.minimum(np.arange(n) / 10.0, 400 * cycles - 1) % 400
    given_ = {a: np.interp(k, np.arange(401), np.append(v, v[0])) for a, v in wave.values.items()}
    assert record.channel("u").values == pytest.approx(given_["x"], abs=1e-9)
    # The first sample sees what was before, and each other the output before it.
    before = {a: np.append(v[0], v[:-1]) for a, v in given_.items()}
    assert record.channel("x").values == pytest.approx(reading(INPUTS[0], before), abs=1e-15)
    assert record.channel("roll").values == pytest.approx(reading(INPUTS[2], before), abs=1e-15)
    assert record.channel("roll").unit == "rad"
    assert "simulated, not measured data" in record.notes
    assert record.attributes["driver"] == "simulated, as requested"
    assert instrument.axes["x"].voltage() == pytest.approx(given_["x"][-1], rel=1e-12)


def test_a_multiplexer_samples_one_sensor_after_the_other_and_the_record_says_so() -> None:
    instrument = card(simultaneous=False)
    # 250 kS/s and 10 us of settling: 14 us from one conversion to the next.
    said = instrument.settings()
    assert "sampled" not in said["sensor x"]
    assert said["sensor y"].endswith(", sampled 14 us after the first sensor")
    assert said["sensor roll"].endswith(", sampled 28 us after the first sensor")
    record = run_waveform(instrument, cosine(), [X, ROLL], rate_hz=10e3)
    given_ = np.interp(np.arange(4000) / 10.0, np.arange(400), cosine().values["x"])
    before = np.append(given_[0], given_[:-1])
    # The first is converted at the edge; 28 us later the outputs have changed.
    assert record.channel("x").values == pytest.approx(
        reading(INPUTS[0], {"x": before, "y": 0.6 * before}), abs=1e-15
    )
    assert record.channel("roll").values == pytest.approx(
        reading(INPUTS[2], {"x": given_, "y": 0.6 * given_}), abs=1e-15
    )
    # Close to the limit of the card there is no time left to settle.
    fast = run_waveform(instrument, cosine(), [X, ROLL], rate_hz=80e3)
    assert fast.attributes["sensor y"].endswith("sampled 4.17 us after the first sensor")
    assert "sampled" not in str(card(simultaneous=True).settings())


@settings(max_examples=25, deadline=None)
@given(
    wave_rate=st.floats(150.0, 4000.0),
    record_rate=st.floats(150.0, 20e3),
    n=st.integers(2, 40),
    cycles=st.integers(1, 3),
    seed=st.integers(0, 99),
)
def test_any_rates_go_together(
    wave_rate: float, record_rate: float, n: int, cycles: int, seed: int
) -> None:
    """The outputs follow the straight lines of the waveform at every sample of the record."""
    rng = np.random.default_rng(seed)
    u = 20.0 + 0.4 * rng.uniform(-1.0, 1.0, n)  # at most 0.8 V from sample to sample
    wave = Waveform(values={"x": u}, sample_rate_hz=wave_rate, quantity="voltage")
    instrument = card(rate=2500.0)
    record = run_waveform(instrument, wave, [U], rate_hz=record_rate, cycles=cycles)
    # A clock of 100 MHz has every rate to a thousandth; the record's own time is the kept one's.
    assert record.sample_rate_hz == pytest.approx(record_rate, rel=1e-3)
    k = record.time * wave_rate
    inside = k <= n * cycles - 1
    expected = np.interp(k[inside] % n, np.arange(n + 1), np.append(u, u[0]))
    assert record.channel("u").values[inside] == pytest.approx(expected, abs=1e-6)
    # The last sample of the waveform comes with the first edge of the clock at or after it.
    last = k > n * cycles - 1 + wave_rate / 2500.0
    assert np.all(record.channel("u").values[last] == u[-1])


def test_a_slow_record_does_not_make_the_outputs_coarse() -> None:
    """At 500 Hz of record the outputs still change 10 000 times a second."""
    backend = SimulatedBackend(WIRING)
    setup = NiSetup(device="Dev1", inputs=INPUTS, outputs=OUTPUTS)
    instrument = NiAcquisition(setup, backend, limits=LIMITS)
    written: list[tuple[int, float]] = []
    opened = backend.open_output

    def watched(*args: object, **options: object) -> object:
        task = opened(*args, **options)  # type: ignore[arg-type]
        written.append((args[1].shape[1], float(np.abs(np.diff(args[1][0])).max())))  # type: ignore[attr-defined]
        return task

    backend.open_output = watched  # type: ignore[method-assign, assignment]
    record = run_waveform(instrument, cosine(), [U, X], rate_hz=500.0)
    assert record.sample_rate_hz == pytest.approx(500.0)
    assert record.size == 200
    samples, step = written[-1]
    assert samples == 3991
    assert step < 1.01 * 35.0 / 15.0 * 2.0 * np.pi / 4000


def test_a_step_beyond_the_slew_becomes_a_ramp() -> None:
    instrument = card()
    backend = instrument._backend
    assert isinstance(backend, SimulatedBackend)
    begin = backend.now
    instrument.axes["x"].set_voltage(100.0)
    assert instrument.axes["x"].voltage() == 100.0
    assert backend.now - begin == pytest.approx(100.0 / 4000.0, rel=0.15)
    begin = backend.now
    instrument.axes["x"].set_voltage(99.7)  # 0.4 V may change with one sample
    assert backend.now - begin < 1e-3


def test_voltages_that_are_set_while_a_record_runs_are_in_it() -> None:
    instrument = card()
    instrument.recorder.configure([U, X], 5e3, 2000)
    instrument.recorder.start()
    instrument.pause(0.05)
    instrument.axes["x"].set_voltage(80.0)
    instrument.pause(0.1)
    instrument.axes["x"].set_voltage(79.8)
    position = instrument.axes["x"].position()  # of the record, whose inputs are taken
    instrument.pause(1.0)
    assert instrument.recorder.available() == 2000
    record = instrument.recorder.read(0, 2000)
    u, x = record.channel("u").values, record.channel("x").values
    assert u[0] == 0.4  # the amplifier's own, while the card gives nothing
    assert u[-1] == 79.8
    assert np.diff(u).max() <= 4000.0 / 5e3 * (1.0 + 1e-9)
    expected = reading(INPUTS[0], {"x": u, "y": 0.0 * u})
    # The number of the sample at which it began is known to some samples: 0.8 V each.
    assert np.abs(x - expected).max() < 4 * 0.8 / 15.0 * 0.83 * 7.1e-6
    assert position == pytest.approx(x[-1], abs=1e-15)
    # What was recorded stays, whatever is done later.
    instrument.axes["x"].set_voltage(3.0)
    assert np.array_equal(instrument.recorder.read(0, 2000).channel("u").values, u)


def test_a_waveform_that_is_started_during_a_record_goes_with_it() -> None:
    instrument = card()
    lead_to(instrument, {"x": 6.0, "y": 3.6}, "voltage")
    instrument.recorder.configure([U, X], 10e3, 4700)
    instrument.recorder.start()
    instrument.pause(0.03)
    instrument.waves.load(cosine())
    instrument.waves.start()
    instrument.pause(1.0)
    record = instrument.recorder.read(0, 4700)
    u, x = record.channel("u").values, record.channel("x").values
    assert np.ptp(u[:300]) == 0.0
    shift = [
        np.abs(x[20:-20] - np.roll(reading(INPUTS[0], {"x": u, "y": 0.6 * u}), k)[20:-20]).max()
        for k in range(-3, 4)
    ]
    assert min(shift) < 1e-12  # in step but for some samples


class Sink:
    def __init__(self) -> None:
        self.parts: list[dict[str, Array]] = []

    def append(self, first: int, columns: Mapping[str, Array]) -> None:
        del first
        self.parts.append(dict(columns))


def test_a_stop_holds_and_safety_follows(monkeypatch: pytest.MonkeyPatch) -> None:
    instrument = card()
    fired = threading.Event()

    backend = instrument._backend
    assert isinstance(backend, SimulatedBackend)
    usual = backend.pause

    def pause(seconds: float) -> None:
        usual(seconds)
        if backend.now > 0.75 and not fired.is_set():
            fired.set()
            thread = threading.Thread(target=instrument.stop)
            thread.start()
            thread.join(10.0)

    backend.pause = pause  # type: ignore[method-assign]
    usual_count = _Output.generated

    def ahead(task: _Output) -> int:
        # a card's memory that was filled beforehand
        return min(usual_count(task) + 300, task.volts.shape[1])

    monkeypatch.setattr(_Output, "generated", ahead)
    sink = Sink()
    with pytest.raises(ControllerError, match=r"the voltage of axis 'x'\) is unknown from"):
        run_waveform(instrument, cosine(1000), [U, X], rate_hz=1000.0, writer=sink)
    assert fired.is_set()
    # What was recorded before the stop is whole; the sensor follows the output it saw.
    u, x = (np.concatenate([p[n] for p in sink.parts]) for n in ("u", "x"))
    assert 200 < u.size < 500
    away = np.abs(x - reading(INPUTS[0], {"x": u, "y": 0.0 * u}))
    assert away.max() < 7.1e-6 * 0.83 / 15.0 * np.abs(np.diff(u)).max()
    # Where the drive was held is read back.
    held = instrument.axes["x"].voltage()
    assert 10.0 < held < 76.0
    assert held == pytest.approx(15.0 * backend.read_outputs(OUTPUTS)[0] + 0.4, abs=1e-12)
    assert instrument.axes["x"].position() == pytest.approx(
        reading(INPUTS[0], {"x": np.array(held), "y": np.array(0.0)}), abs=1e-12
    )
    with pytest.raises(ValueError, match="enough"), guarded(instrument):
        raise ValueError("enough")
    assert instrument.axes["x"].voltage() == 6.0
    assert instrument.axes["y"].voltage() == 0.0


def test_a_card_that_cannot_read_its_outputs_claims_no_voltage_after_a_stop() -> None:
    instrument = card(readable=False)
    assert "0.4 V when connected (assumed" in instrument.settings()["drive x"]
    instrument.axes["x"].set_voltage(6.0)
    instrument.waves.load(cosine())
    instrument.waves.start()
    instrument.pause(0.1)
    assert 6.0 < instrument.axes["x"].voltage() < 76.0  # while it runs
    instrument.stop()
    assert np.isnan(instrument.axes["x"].voltage())
    with pytest.raises(ControllerError, match="this card cannot read it back: measure it"):
        instrument.axes["x"].set_voltage(3.0)
    with pytest.raises(ControllerError, match="the voltage of axis 'x' is unknown: measure it"):
        instrument.close()


def test_a_ramp_that_is_cut_short_is_read_back() -> None:
    instrument = card()
    backend = instrument._backend
    assert isinstance(backend, SimulatedBackend)
    usual = backend.pause

    def pause(seconds: float) -> None:
        usual(seconds)
        if backend.now > 0.01:
            instrument.stop()

    backend.pause = pause  # type: ignore[method-assign]
    instrument.axes["x"].set_voltage(100.0)
    assert 20.0 < instrument.axes["x"].voltage() < 60.0
    assert instrument.axes["x"].voltage() == pytest.approx(
        15.0 * backend.read_outputs(OUTPUTS)[0] + 0.4, abs=1e-12
    )


def test_what_the_outputs_give_is_looked_at_before_the_first_voltage() -> None:
    # Another program left 3.2 V at the first output: 48.4 V behind the amplifier.
    instrument = card(standing={"Dev1/ao0": 3.2, "Dev1/ao1": 0.004})
    assert instrument.axes["x"].voltage() == pytest.approx(48.4)
    assert instrument.axes["y"].voltage() == 0.0  # what is within the errors of a card is 0 V
    assert instrument.settings()["drive x"].endswith("48.4 V when connected (read back)")
    backend = instrument._backend
    assert isinstance(backend, SimulatedBackend)
    begin = backend.now
    instrument.axes["x"].set_voltage(100.0)  # by a ramp from there
    assert backend.now - begin == pytest.approx((100.0 - 48.4) / 4000.0, rel=0.3)
    said = DriveOutput(channel="Dev1/ao0", axis="x", sensor="x", gain=15.0, standing=30.0)
    setup = NiSetup(device="Dev1", inputs=INPUTS, outputs=(said,))
    with pytest.raises(ControllerError, match=r"is at 3\.2 V, which is 48 V at the drive of axis"):
        NiAcquisition(setup, SimulatedBackend(WIRING, standing={"Dev1/ao0": 3.2}), limits=LIMITS)


def test_close_leads_to_safety_unless_told_not_to() -> None:
    for lead, expected in ((True, 6.0), (False, 55.0)):
        instrument = card(lead_to_safe=lead)
        instrument.axes["x"].set_voltage(55.0)
        instrument.close()
        instrument.close()
        assert instrument.axes["x"].voltage() == expected


def test_what_does_not_fit_is_refused() -> None:
    instrument = card()
    with pytest.raises(ControllerError, match="no waveform was loaded"):
        instrument.waves.start()
    instrument.waves.load(cosine())
    with pytest.raises(LimitError, match=r"is at 0\.4 V and the waveform starts at 6 V"):
        instrument.waves.start()
    with pytest.raises(LimitError, match="at least 1 cycle"):
        instrument.waves.start(0)
    with pytest.raises(ModelError, match="'target' of 'x'"):
        instrument.recorder.configure([Signal(kind="target", source="x", name="r")], 1e3, 10)
    with pytest.raises(ModelError, match="'channel' of '4'"):
        instrument.recorder.configure([Signal(kind="channel", source="4", name="r")], 1e3, 10)
    limit = r"up to 83333\.3 Hz \(250000 samples/s shared by 3 inputs\), got 90000.0 Hz"
    with pytest.raises(ModelError, match=limit):
        card(simultaneous=False).recorder.configure([X], 90e3, 10)
    with pytest.raises(ModelError, match=r"up to 250000 Hz \(limit of its inputs\)"):
        instrument.recorder.configure([X], 260e3, 10)
    with pytest.raises(ModelError, match="samples at up to 83333"):
        card(rate=90e3, simultaneous=False)
    with pytest.raises(ControllerError, match="configure the recorder first"):
        instrument.recorder.start()
    with pytest.raises(ModelError, match="sensors 1 to 3"):
        instrument.channel(0)
    with pytest.raises(ModelError, match="excite by hand"):
        instrument.strike("x")
    assert instrument.axes["x"].voltage() == 0.4


def test_while_a_waveform_runs_no_voltage_is_taken() -> None:
    instrument = card()
    flat = Waveform(values={"x": np.full(500, 0.4)}, sample_rate_hz=100.0, quantity="voltage")
    instrument.waves.load(flat)
    instrument.waves.start()
    with pytest.raises(ControllerError, match="accepts no voltage until it ends"):
        instrument.axes["y"].set_voltage(3.0)
    with pytest.raises(ControllerError, match="a waveform is running"):
        instrument.waves.start()
    with pytest.raises(ControllerError, match="still ran after 1 s"):
        instrument.axes["x"].wait(1.0)
    assert not instrument.axes["x"].moving()


def test_a_record_that_is_not_read_says_so() -> None:
    instrument = card()
    instrument.recorder.configure([X], 10e3, 300_000)
    instrument.recorder.start()
    instrument.pause(11.0)
    with pytest.raises(ControllerError, match="read more often"):
        instrument.recorder.available()


def test_a_full_record_gives_the_inputs_free() -> None:
    instrument = card()
    record_now(instrument, [X], 10e3, 500)
    instrument.pause(60.0)  # longer than any buffer
    assert instrument.axes["x"].position() == pytest.approx(-3e-6, abs=1e-18)


def test_noise_is_there_and_repeats() -> None:
    first, second = (record_now(card(noise=1.3e-3), [X], 10e3, 4000) for _ in range(2))
    x = first.channel("x").values
    assert x.std() == pytest.approx(1.3e-3 * 7.1e-6, rel=0.05)  # four deviations of 1/sqrt(2 n)
    assert np.array_equal(x, second.channel("x").values)


def test_a_card_of_sensors_only() -> None:
    setup = NiSetup(device="Dev1", inputs=INPUTS)
    instrument = NiAcquisition(setup, SimulatedBackend({}, at_rest={"Dev1/ai3": 0.7}))
    assert instrument.capabilities == {Capability.DATA_RECORDER, Capability.CHANNELS}
    assert instrument.channel(1) == pytest.approx(0.7 * 7.1e-6 - 3e-6)
    with pytest.raises(ModelError, match="has no drives"):
        _ = instrument.waves
    record = record_now(instrument, [ROLL], 777.0, 50)
    assert record.size == 50
    instrument.close()


@pytest.mark.parametrize(
    ("made", "match"),
    [
        (lambda: SensorInput(channel="a", name="x", gain=0.0), "not zero"),
        (lambda: SensorInput(channel="a", name="x", gain=1.0, voltage_range=(1, 1)), "must rise"),
        (lambda: DriveOutput(channel="a", axis="x", sensor="x", gain=-15.0), "positive"),
        (lambda: DriveOutput(channel="a", axis="x", sensor="x", standing=11.0), "cannot be at"),
        (lambda: NiSetup(device="D", inputs=()), "at least one sensor"),
        (lambda: NiSetup(device="D", inputs=(INPUTS[0], INPUTS[0])), "two sensors have the name"),
        (lambda: NiSetup(device="D", inputs=INPUTS[1:], outputs=OUTPUTS), "no sensor 'x': it has"),
        (lambda: NiSetup(device="D", inputs=INPUTS, output_rate_hz=-1.0), "rate of the outputs"),
        (
            lambda: NiSetup(
                device="D",
                inputs=INPUTS,
                outputs=(OUTPUTS[0], DriveOutput(channel="Dev1/ao0", axis="z", sensor="x")),
            ),
            "two channels are 'Dev1/ao0'",
        ),
    ],
)
def test_what_is_wired_wrongly(made: object, match: str) -> None:
    with pytest.raises(ModelError, match=match):
        made()  # type: ignore[operator]


def test_an_address_names_the_wires_of_a_stage() -> None:
    stage = design("vgtu-piezo")
    address = "ni://Dev3?y=ao3,ai6&amplifier=15&sensitivity=8um/V&rate=20kHz&simulated=1&seed=4"
    instrument = open_address(address, stage)
    drives = {d.axis: (d.channel, d.gain) for d in instrument.setup.outputs}
    assert drives == {"x": ("Dev3/ao0", 15.0), "y": ("Dev3/ao3", 15.0)}
    assert [s.channel for s in instrument.setup.inputs] == ["Dev3/ai0", "Dev3/ai6"]
    assert instrument.setup.inputs[0].gain == pytest.approx(8e-6)
    assert instrument.waves.base_rate_hz == 20e3
    # The stage's stack takes 0 to 120 V, and 40 V/ms.
    assert instrument.axes["y"].limits.voltage == (0.0, 120.0)
    assert instrument.axes["y"].limits.slew == 40e3
    assert "as requested" in instrument.settings()["driver"]
    instrument.axes["y"].set_voltage(120.0)
    # A simulated sensor goes to 80 % of its range.
    assert instrument.axes["y"].position() == pytest.approx(8.0 * 8e-6, rel=1e-3)
    other = open_address("ni://Dev3?simulated=yes", stage, axes={"x": "ao1,ai1", "y": "ao0,ai2"})
    assert other.setup.outputs[0].channel == "Dev3/ao1"
    # Without the amplifier's gain only the card's own 10 V are there.
    assert other.axes["x"].limits.voltage == (0.0, 10.0)


def test_an_address_wires_each_sensor_and_drive_by_itself() -> None:
    address = (
        "ni://Dev1?x=ao0,ai0&y=ao1,ai8&roll=ai2&simulated=1&amplifier=15&amplifier.y=18&bias.y=-30V"
        "&standing.y=24V&sensitivity=8.2um/V&sensitivity.y=-4um/V&sensitivity.roll=30urad/V"
        "&offset.x=1.3um&offset.roll=2mrad&range=5V&range.roll=0V:10V&terminal=RSE"
        "&terminal.y=pseudo-diff"
    )
    instrument = open_address(address, design("vgtu-piezo"))
    assert instrument.setup.inputs == (
        SensorInput(
            channel="Dev1/ai0", name="x", gain=8.2e-6,
            offset=1.3e-6, voltage_range=(-5.0, 5.0), terminal="rse",
        ),
        SensorInput(
            channel="Dev1/ai8", name="y", gain=-4e-6,
            voltage_range=(-5.0, 5.0), terminal="pseudo_diff",
        ),
        SensorInput(
            channel="Dev1/ai2", name="roll", unit="rad", gain=3e-5,
            offset=2e-3, voltage_range=(0.0, 10.0), terminal="rse",
        ),
    )  # fmt: skip
    assert instrument.setup.outputs == (
        DriveOutput(channel="Dev1/ao0", axis="x", sensor="x", gain=15.0),
        DriveOutput(
            channel="Dev1/ao1", axis="y", sensor="y", gain=18.0, offset=-30.0, standing=24.0
        ),
    )
    # The card gives 3 V at ao1, which the amplifier makes 24 V; the third sensor has no axis.
    assert instrument.axes["y"].voltage() == 24.0
    assert instrument.channel(3) == pytest.approx(2e-3, abs=5 * 0.2e-3 * 3e-5)


@pytest.mark.parametrize(
    ("address", "match"),
    [
        ("ni://?simulated=1", "must be such as"),
        ("ni://Dev1/x?simulated=1", "must be such as"),
        ("ni://Dev1?simulated=1", "names no axis"),
        ("ni://Dev1?simulated=maybe", "'simulated' of .* must be 1 or 0"),
        ("ni://Dev1?x=ao0&simulated=1", "an output and an input for 'x'"),
        ("ni://Dev1?x=ai0,ao0&simulated=1", "an output and an input for 'x'"),
        ("ni://Dev1?x=ao0,ai0&x=ao1,ai1", "an option twice"),
        ("ni://Dev1?x=ao0,ai0&simulated=1&seed=-1", "'seed' of .* must be a whole number"),
        (
            "ni://Dev1?x=ao0,ai0&simulated=1&sensitivity=10um",
            "'sensitivity' in the address .* 'um'",
        ),
        (
            "ni://Dev1?x=ao0,ai0&simulated=1&amplifier=big",
            "expected a number such as 15, got 'big'",
        ),
        ("ni://Dev1?x=ao0,ai0&simulated=1&terminal=single", "expected default, diff, nrse, pseudo"),
        ("ni://Dev1?x=ao0,ai0&simulated=1&range=5V:-5V", "must rise"),
        ("ni://Dev1?x=ao0,ai0&simulated=1&range=5", "has no unit"),
        (
            "ni://Dev1?x=ao0,ai0&simulated=1&range.z=5V",
            r"unknown option 'range.z': sensors \(x\) have",
        ),
        (
            "ni://Dev1?x=ao0,ai0&roll=ai2&simulated=1&amplifier.roll=2",
            "unknown option 'amplifier.roll'",
        ),
        ("ni://Dev1?x=ao0,ai0&simulated=1&rate.x=2kHz", "unknown option 'rate.x'"),
        ("ni://Dev1?x=ao0,ai0&simulated=1&standing=11V", "cannot be at 11 V"),
        ("ni://Dev1?x=ao0,ai0&simulated=1&sensitivity=3urad/V", "'sensitivity' in the address"),
        ("ni://Dev1?roll=ai2&simulated=1", "names no axis"),
        ("ni://Dev1?x=ao0,ai0&simulated=1&amplifier=-2", "must be positive"),
    ],
)
def test_addresses_that_are_none(address: str, match: str) -> None:
    with pytest.raises(ModelError, match=match):
        open_address(address)


def test_a_screw_takes_no_voltage() -> None:
    with pytest.raises(ModelError, match="has no voltage range"):
        open_address("ni://Dev1?simulated=1", design("vgtu-mechanical"))
    with pytest.raises(ModelError, match="the options are x, y, rate, simulated, seed, sens"):
        open_address("ni://Dev1?simulated=1&gain=15", design("vgtu-piezo"))
    setup = NiSetup(device="Dev1", inputs=INPUTS, outputs=OUTPUTS)
    with pytest.raises(ModelError, match=r"'rate' of .* and 'setup' both describe"):
        open_address("ni://Dev1?simulated=1&rate=1kHz", setup=setup)
    assert open_address("ni://Dev1?simulated=1", setup=setup).setup is setup
