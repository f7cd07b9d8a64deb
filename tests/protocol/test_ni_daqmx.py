"""What NI's own package is asked for: names, arguments and order, and its errors in our words."""

import numpy as np
import pytest

pytest.importorskip("nidaqmx")

from nidaqmx.constants import AcquisitionType, Edge, TerminalConfiguration
from nidaqmx.error_codes import DAQmxErrors

from flexstage.errors import ControllerError, ModelError, NotConnectedError
from flexstage.instruments.acquire import record_now, run_waveform
from flexstage.instruments.guard import guarded
from flexstage.instruments.limits import AxisLimits
from flexstage.instruments.ni import (
    DriveOutput,
    NiAcquisition,
    NiSetup,
    SensorInput,
    address,
    daqmx,
    daqmx_codes,
    open_address,
)
from flexstage.instruments.ni.daqmx import DaqmxBackend, driver_found
from flexstage.instruments.protocol import Signal
from flexstage.instruments.waveform import Waveform
from tests.daqmx_stand_in import Card, value

SETUP = NiSetup(
    device="Dev1",
    inputs=(
        SensorInput(channel="Dev1/ai2", name="x", gain=6.3e-6, terminal="diff"),
        SensorInput(channel="Dev1/ai5", name="roll", unit="rad", gain=3e-5, voltage_range=(-5, 5)),
    ),
    outputs=(
        DriveOutput(channel="Dev1/ao0", axis="x", sensor="x", gain=15.0),
        DriveOutput(channel="Dev1/ao1", axis="y", sensor="x", gain=12.0, voltage_range=(-2, 9)),
    ),
    output_rate_hz=5e3,
    lead_to_safe=False,
)
SIGNALS = [
    Signal(kind="voltage", source="x", name="u", unit="V"),
    Signal(kind="position", source="x", name="x"),
    Signal(kind="channel", source="2", name="roll", unit="rad"),
]
LIMITS = {"x": AxisLimits(slew=4e4), "y": AxisLimits(slew=4e4)}


@pytest.fixture
def card() -> Card:
    return Card()


@pytest.fixture
def instrument(card: Card, monkeypatch: pytest.MonkeyPatch) -> NiAcquisition:
    monkeypatch.setattr(daqmx.time, "sleep", lambda _: None)
    return NiAcquisition(SETUP, DaqmxBackend(card.library()), limits=LIMITS)


def wave() -> Waveform:
    u = 20.0 - 20.0 * np.cos(2.0 * np.pi * np.arange(300) / 300)
    return Waveform(values={"x": u, "y": 0.4 * u}, sample_rate_hz=500.0, quantity="voltage")


def test_connecting_asks_for_type_and_number_and_no_more(
    card: Card, instrument: NiAcquisition
) -> None:
    assert instrument.identity.model == "PCIe-6363"
    assert instrument.identity.serial_number == "01D0C2AF"
    assert not instrument.identity.simulated
    assert card.names() == ["Device"]
    assert card.log[0][1]["name"] == "Dev1"


def test_outputs_share_clock_and_start_of_the_inputs(card: Card, instrument: NiAcquisition) -> None:
    record = run_waveform(instrument, wave(), SIGNALS, rate_hz=1000.0)
    clocks = [a for n, a in card.log if n == "Task.timing.cfg_samp_clk_timing"][-2:]
    inputs, outputs = clocks
    assert inputs["sample_mode"] == AcquisitionType.CONTINUOUS
    assert (inputs["rate"], inputs["samps_per_chan"], inputs["source"]) == (5e3, 50_000, "")
    assert outputs["sample_mode"] == AcquisitionType.FINITE
    assert outputs["source"] == "/Dev1/ai/SampleClock"
    assert outputs["active_edge"] == Edge.RISING
    assert (outputs["rate"], outputs["samps_per_chan"]) == (5e3, 2991)
    trigger = card.only("Task.triggers.start_trigger.cfg_dig_edge_start_trig")
    assert trigger == {"trigger_source": "/Dev1/ai/StartTrigger", "trigger_edge": Edge.RISING}
    # The outputs wait, all samples written, before the inputs start.
    names = card.names()
    begin = names.index("Task.triggers.start_trigger.cfg_dig_edge_start_trig")
    assert names[begin : begin + 5] == [
        "Task.triggers.start_trigger.cfg_dig_edge_start_trig",
        "AnalogMultiChannelWriter",
        "AnalogMultiChannelWriter.write_many_sample",
        "Task.start",
        "Task.start",
    ]
    assert card.ready == [True]
    waiting, clock = [t.state for t in card.tasks if t.state.source][-1], card.tasks[-2].state
    assert waiting.started
    assert clock.started
    assert all(t.state.closed for t in card.tasks)
    # The card's volts are the drive's over the gain of its amplifier.
    u = wave().values["x"]
    full = np.interp(np.arange(2991) / 10.0, np.arange(300), u)
    assert waiting.samples[0] == pytest.approx(full / 15.0, abs=1e-12)
    assert waiting.samples[1] == pytest.approx(0.4 * full / 12.0, abs=1e-12)
    # One sample of five is kept of what the card sampled.
    assert record.size == 600
    k = 5.0 * np.arange(600)
    assert record.channel("x").values == pytest.approx(
        6.3e-6 * (value("Dev1/ai2") + 1e-6 * k), rel=1e-12
    )
    assert record.channel("roll").values == pytest.approx(
        3e-5 * (value("Dev1/ai5") + 1e-6 * k), rel=1e-12
    )
    held = np.append(full, np.full(10, full[-1]))
    assert record.channel("u").values == pytest.approx(held[::5][:600], abs=1e-9)
    assert record.attributes["driver"] == "NI-DAQmx by nidaqmx of the tests"


def test_channels_have_their_ranges_and_wiring(card: Card, instrument: NiAcquisition) -> None:
    assert instrument.channel(1) == pytest.approx(6.3e-6 * value("Dev1/ai2"))
    made = card.only("Task.ai_channels.add_ai_voltage_chan")
    assert made["physical_channel"] == "Dev1/ai2"
    assert made["terminal_config"] == TerminalConfiguration.DIFF
    assert (made["min_val"], made["max_val"]) == (-10.0, 10.0)
    assert card.only("AnalogMultiChannelReader.read_one_sample")["timeout"] > 0.0
    instrument.axes["y"].set_voltage(6.0)
    assert card.held == {"Dev1/ao1": 0.5}
    made = card.only("Task.ao_channels.add_ao_voltage_chan")
    assert (made["min_val"], made["max_val"]) == (-2, 9)
    assert card.only("AnalogMultiChannelWriter")["auto_start"] is True
    assert all(t.state.closed for t in card.tasks)


def test_a_ramp_goes_with_the_outputs_own_clock(card: Card, instrument: NiAcquisition) -> None:
    instrument.axes["x"].set_voltage(90.0)
    timing = card.only("Task.timing.cfg_samp_clk_timing")
    assert timing["source"] == ""
    assert timing["sample_mode"] == AcquisitionType.FINITE
    # 40 kV/s at 5 kHz are 8 V a sample: 12 steps for 90 V.
    assert timing["samps_per_chan"] == 12
    samples = card.tasks[-1].state.samples[0] * 15.0
    assert samples[-1] == pytest.approx(90.0)
    assert np.abs(np.diff(samples, prepend=0.0)).max() <= 8.0
    assert "Task.triggers.start_trigger.cfg_dig_edge_start_trig" not in card.names()


def test_a_waveform_during_a_record_goes_with_its_clock_at_once(
    card: Card, instrument: NiAcquisition
) -> None:
    run_waveform(instrument, wave(), SIGNALS, rate_hz=1000.0, before=100)
    outputs = [a for n, a in card.log if n == "Task.timing.cfg_samp_clk_timing"][-1]
    assert outputs["source"] == "/Dev1/ai/SampleClock"
    # The start of the inputs has passed: who waited for it would wait for ever.
    assert "Task.triggers.start_trigger.cfg_dig_edge_start_trig" not in card.names()


def test_a_stop_reaches_the_card_and_the_voltage_is_what_was_put_out(
    card: Card, instrument: NiAcquisition
) -> None:
    instrument.waves.load(wave())
    instrument.waves.start()
    assert instrument.waves.running()
    instrument.stop()
    state = card.tasks[-1].state
    assert state.stopped
    assert state.closed
    n = state.generated
    assert 0 < n < 2991
    assert instrument.axes["x"].voltage() == pytest.approx(15.0 * state.samples[0, n - 1])
    assert card.names()[-2:] == ["Task.stop", "Task.close"]


def test_where_the_card_does_not_tell_nobody_goes_on_from_a_guess(
    card: Card, instrument: NiAcquisition
) -> None:
    instrument.waves.load(wave())
    instrument.waves.start()
    card.faults = {"Task.out_stream.total_samp_per_chan_generated": -201003}
    instrument.stop()  # never raises
    assert "Task.stop" in card.names()
    card.faults = {}
    assert np.isnan(instrument.axes["x"].voltage())
    with pytest.raises(ControllerError, match="nobody knows the voltage of axis 'x'"):
        instrument.axes["x"].set_voltage(3.0)
    with pytest.raises(ValueError, match="first") as caught, guarded(instrument):
        raise ValueError("first")
    assert "reads nan as its voltage" in caught.value.__notes__[0]


@pytest.mark.parametrize(
    ("code", "error", "match"),
    [
        (-201003, NotConnectedError, "cannot be reached"),
        (-200220, NotConnectedError, "no such card"),
        (-50103, ControllerError, "another program or task"),
        (-200279, ControllerError, "overwritten before they were read"),
        (-200170, ControllerError, "no such channel"),
        (-209999, ControllerError, r"error -209999: The words of the driver$"),
    ],
)
def test_errors_of_the_driver_in_our_words(
    card: Card, instrument: NiAcquisition, code: int, error: type[Exception], match: str
) -> None:
    for name in ("Task.start", "AnalogMultiChannelReader.read_many_sample"):
        card.faults = {name: code}
        with pytest.raises(error, match=match) as caught:
            record_now(instrument, SIGNALS, 1000.0, 3000)
        if isinstance(caught.value, ControllerError):
            assert caught.value.code == code
    card.faults = {"AnalogMultiChannelWriter.write_many_sample": code}
    with pytest.raises(error, match=match):
        instrument.axes["x"].set_voltage(90.0)
    card.faults = {}
    record_now(instrument, SIGNALS, 1000.0, 10)  # nothing was left reserved
    instrument.close()
    assert all(t.state.closed for t in card.tasks)


def test_the_sentences_are_for_the_errors_that_they_mean() -> None:
    names = {code: DAQmxErrors(code).name for code in daqmx_codes.SENTENCES}
    assert names[-200279] == "SAMPLES_NO_LONGER_AVAILABLE"
    assert names[-50103] == "PAL_RESOURCE_RESERVED"
    assert names[-200170] == "PHYSICAL_CHAN_DOES_NOT_EXIST"
    assert names[-200290] == "GEN_STOPPED_TO_PREVENT_REGEN_OF_OLD_SAMPLES"
    assert names[-201003] == "DEV_CANNOT_BE_ACCESSED"
    assert names[-200019] == "ADC_OVERRUN"
    assert names[-200284] == "SAMPLES_NOT_YET_AVAILABLE"
    assert all(DAQmxErrors(code) for code in daqmx_codes.GONE)


def test_with_a_driver_the_card_is_real_unless_asked_otherwise(
    card: Card, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(address, "driver_found", lambda: "")
    monkeypatch.setattr(address, "DaqmxBackend", lambda: DaqmxBackend(card.library()))
    real = open_address("ni://Dev1?x=ao0,ai2&sensitivity=3um/V&amplifier=1")
    assert not real.identity.simulated
    assert real.channel(1) == pytest.approx(3e-6 * value("Dev1/ai2"))
    assert open_address("ni://Dev1?x=ao0,ai2&simulated=1").identity.simulated
    # Nobody may guess what a real sensor reads for a volt.
    with pytest.raises(ModelError, match="sensitivity=10um/V"):
        open_address("ni://Dev1?x=ao0,ai2")
    # Nor by what a drive gets more than the output gives.
    with pytest.raises(ModelError, match="'amplifier=1' where there are none"):
        open_address("ni://Dev1?x=ao0,ai2&sensitivity=3um/V")


@pytest.mark.skipif(not driver_found(), reason="NI-DAQmx is installed here")
def test_without_a_driver_the_card_is_simulated_and_says_so() -> None:
    assert driver_found() == "the driver NI-DAQmx is not installed on this computer"
    instrument = open_address("ni://Dev1?x=ao0,ai0&amplifier=15")
    assert instrument.identity.simulated
    assert "since the driver NI-DAQmx is not installed" in instrument.settings()["driver"]
    record = record_now(instrument, [Signal(kind="position", source="x", name="x")], 1000.0, 20)
    assert record.attributes["simulated"] == "yes"
    assert record.notes[0].startswith("simulated")
    # The real package itself, asked here, says what is missing.
    with pytest.raises(NotConnectedError, match="is not installed on this computer"):
        NiAcquisition(SETUP, DaqmxBackend())
    with pytest.raises(NotConnectedError, match="is not installed on this computer"):
        DaqmxBackend().read_now(SETUP.inputs)
    with pytest.raises(NotConnectedError, match="is not installed on this computer"):
        DaqmxBackend().open_input(SETUP.inputs, 1e3, 1000)
