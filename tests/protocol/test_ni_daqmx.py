"""What NI's own package is asked for: names, arguments and order, and its errors in our words.

Evidence (Instruments, twin, control): NI calls (`nidaqmx` signatures): exact, no card
"""

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("nidaqmx")

from nidaqmx.constants import AcquisitionType, Edge, ProductCategory, TerminalConfiguration
from nidaqmx.error_codes import DAQmxErrors

from flexstage.base.errors import ControllerError, ModelError, NotConnectedError
from flexstage.instruments.guard import guarded
from flexstage.instruments.ni import address, daqmx
from flexstage.instruments.ni.acquisition import NiAcquisition
from flexstage.instruments.ni.address import open_address
from flexstage.instruments.ni.daqmx import DaqmxBackend, driver_found
from flexstage.instruments.ni.setup import DriveOutput, NiSetup, SensorInput
from flexstage.instruments.protocol import Signal, Waveform
from flexstage.instruments.record_run import record_now, run_waveform
from flexstage.stage.limits import AxisLimits
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


def test_connecting_asks_and_moves_nothing(card: Card, instrument: NiAcquisition) -> None:
    assert instrument.identity.model == "PCIe-6363"
    assert instrument.identity.serial_number == "01D0C2AF"
    assert not instrument.identity.simulated
    assert card.log[0] == ("Device", {"name": "Dev1", "grpc_options": None})
    # A task to ask for the timing, one to read the outputs back; none is run or written.
    assert card.names().count("Task") == 2
    assert not [n for n in card.names() if n.endswith((".start", "write_one_sample"))]
    assert [a["physical_channel"] for n, a in card.log if n.endswith("add_ai_voltage_chan")] == [
        "Dev1/ai2", "Dev1/ai5", "Dev1/_ao0_vs_aognd", "Dev1/_ao1_vs_aognd",
    ]  # fmt: skip
    assert all(t.state.closed for t in card.tasks)


def test_outputs_take_the_clock_of_the_inputs_and_start_first(
    card: Card, instrument: NiAcquisition
) -> None:
    record = run_waveform(instrument, wave(), SIGNALS, rate_hz=1000.0)
    clocks = [a for n, a in card.log if n == "Task.timing.cfg_samp_clk_timing"][-2:]
    inputs, outputs = clocks
    assert inputs["sample_mode"] == AcquisitionType.CONTINUOUS
    assert (inputs["rate"], inputs["samps_per_chan"], inputs["source"]) == (5e3, 50_000, "")
    assert outputs["sample_mode"] == AcquisitionType.FINITE
    assert outputs["source"] == "/Dev1/ai/SampleClock"
    assert outputs["active_edge"] == Edge.RISING
    assert (outputs["rate"], outputs["samps_per_chan"]) == (5e3, 2991)
    # The outputs wait for the clock, all samples written, before the inputs start; a trigger
    # beside the clock could come after its first edge.
    names = card.names()
    assert not [n for n in names if "trig" in n]
    begin = names.index("Task.start", len(names) - names[::-1].index("AnalogMultiChannelWriter"))
    assert names[begin - 2 : begin + 2] == [
        "AnalogMultiChannelWriter",
        "AnalogMultiChannelWriter.write_many_sample",
        "Task.start",
        "Task.start",
    ]
    assert card.ready[-1]
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
    card.log.clear()
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
    card.log.clear()
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
    instrument.recorder.configure(SIGNALS, 1000.0, 300)
    instrument.recorder.start()
    instrument.waves.load(wave())
    instrument.waves.start()
    outputs = [a for n, a in card.log if n == "Task.timing.cfg_samp_clk_timing"][-1]
    assert outputs["source"] == "/Dev1/ai/SampleClock"
    # The start of the inputs has passed: who waited for it would wait for ever.
    assert "Task.triggers.start_trigger.cfg_dig_edge_start_trig" not in card.names()


def test_after_a_stop_the_outputs_are_read_back(card: Card, instrument: NiAcquisition) -> None:
    # A card at USB takes up to 8191 samples into its memory, and counts them as put out.
    card.ahead = 700
    instrument.waves.load(wave())
    instrument.waves.start()
    assert instrument.waves.running()
    instrument.stop()
    state = card.tasks[-1].state
    assert state.stopped
    assert state.closed
    assert card.names()[-2:] == ["Task.stop", "Task.close"]
    n = state.generated
    assert 0 < n < 2991 - card.ahead
    assert instrument.axes["x"].voltage() == pytest.approx(15.0 * state.samples[0, n - 1])
    assert instrument.axes["y"].voltage() == pytest.approx(12.0 * state.samples[1, n - 1])
    asked = [a["physical_channel"] for m, a in card.log if m.endswith("add_ai_voltage_chan")]
    assert asked[-2:] == ["Dev1/_ao0_vs_aognd", "Dev1/_ao1_vs_aognd"]
    # They are read once, and known from then on.
    before = len(card.log)
    assert instrument.axes["x"].voltage() > 0.0
    assert len(card.log) == before


def test_a_stop_during_a_record_ends_in_the_safe_voltage(
    card: Card, instrument: NiAcquisition
) -> None:
    card.ahead = 700
    instrument.recorder.configure(SIGNALS, 1000.0, 600)
    instrument.recorder.arm()
    instrument.waves.load(wave())
    instrument.waves.start()
    assert instrument.waves.running()
    with pytest.raises(ValueError, match="first"), guarded(instrument):
        raise ValueError("first")
    # The inputs of the record were given free to read the outputs back, and led to safety from.
    assert card.held == {"Dev1/ao0": 0.0, "Dev1/ao1": 0.0}
    assert all(t.state.closed for t in card.tasks)


def test_a_card_that_cannot_read_its_outputs_claims_nothing_after_a_stop(card: Card) -> None:
    card.readable = False
    instrument = NiAcquisition(SETUP, DaqmxBackend(card.library()), limits=LIMITS)
    assert "assumed, this card cannot read it back" in instrument.settings()["drive x"]
    instrument.waves.load(wave())
    instrument.waves.start()
    assert instrument.waves.running()
    instrument.stop()  # never raises
    assert "Task.stop" in card.names()
    assert np.isnan(instrument.axes["x"].voltage())
    with pytest.raises(ControllerError, match="the voltage of axis 'x' is unknown"):
        instrument.axes["x"].set_voltage(3.0)
    with pytest.raises(ValueError, match="first") as caught, guarded(instrument):
        raise ValueError("first")
    assert "the voltage of axis 'x' is unknown" in caught.value.__notes__[0]


def test_outputs_are_read_back_before_the_first_voltage(card: Card) -> None:
    card.held = {"Dev1/ao0": 2.4, "Dev1/ao1": -0.003}
    instrument = NiAcquisition(SETUP, DaqmxBackend(card.library()), limits=LIMITS)
    assert instrument.axes["x"].voltage() == pytest.approx(36.0)
    assert instrument.axes["y"].voltage() == 0.0
    made = [a for n, a in card.log if n.endswith("add_ai_voltage_chan")][-1]
    assert (made["min_val"], made["max_val"]) == (-10.0, 10.0)  # whatever another program left
    said = replace(SETUP.outputs[0], standing=0.0)
    with pytest.raises(
        ControllerError, match=r"'Dev1/ao0' is at 2\.4 V, which is 36 V at the drive"
    ):
        NiAcquisition(replace(SETUP, outputs=(said,)), DaqmxBackend(card.library()))


def test_a_card_that_ni_max_simulates_is_recorded_as_simulated(card: Card) -> None:
    card.facts["is_simulated"] = True
    instrument = NiAcquisition(SETUP, DaqmxBackend(card.library()), limits=LIMITS)
    assert instrument.identity.simulated
    assert (instrument.identity.vendor, instrument.identity.model) == ("NI", "PCIe-6363")
    assert instrument.settings()["driver"].startswith("card simulated by NI MAX: not measured data")
    record = run_waveform(instrument, wave(), SIGNALS, rate_hz=1000.0)
    assert record.attributes["simulated"] == "yes"
    assert "simulated, not measured data" in record.notes
    assert instrument.recorder.read(0, 3).notes == (instrument.settings()["driver"],)
    # Its inputs give a sine, so that no output is read back by them.
    assert not [a for n, a in card.log if "_vs_aognd" in str(a.get("physical_channel"))]


@pytest.mark.parametrize(
    ("facts", "limit"),
    [
        ({}, r"500000 Hz \(1e\+06 samples/s shared by 2 inputs\)"),
        ({"ai_max_single_chan_rate": 4e5}, r"400000 Hz \(limit of its inputs\)"),
        ({"ao_max_rate": 9e4}, r"90000 Hz \(limit of its outputs\)"),
        ({"ai_simultaneous_sampling_supported": True}, r"1e\+06 Hz \(limit of its inputs\)"),
    ],
)
def test_the_largest_rate_is_the_cards_own(card: Card, facts: dict, limit: str) -> None:
    card.facts |= facts
    instrument = NiAcquisition(SETUP, DaqmxBackend(card.library()), limits=LIMITS)
    with pytest.raises(ModelError, match=r"card 'Dev1' \(PCIe-6363\) samples at up to " + limit):
        instrument.recorder.configure(SIGNALS, 2.5e6, 100)
    largest = instrument.recorder.base_rate_hz
    assert instrument.recorder.configure(SIGNALS, largest, 100) == largest
    with pytest.raises(ModelError, match=limit):
        NiAcquisition(replace(SETUP, output_rate_hz=3e6), DaqmxBackend(card.library()))


def test_sensors_alone_are_not_asked_for_outputs(card: Card) -> None:
    for name in ("ao_max_rate", "ao_samp_clk_supported", "product_category"):
        del card.facts[name]
    card.facts |= {"ai_max_single_chan_rate": 1000.0, "ai_max_multi_chan_rate": 1000.0}
    setup = replace(SETUP, outputs=())
    instrument = NiAcquisition(setup, DaqmxBackend(card.library()))
    # Nothing needs a faster clock than the record has.
    assert instrument.recorder.configure([SIGNALS[2]], 300.0, 10) == 300.0
    clocks = [a["rate"] for n, a in card.log if n.endswith("cfg_samp_clk_timing")]
    assert clocks == [500.0, 300.0]


@pytest.mark.parametrize(
    ("model", "category", "clocked"),
    [
        ("USB-6009", "USBDAQ", False),
        ("USB-6003", "USBDAQ", True),
        ("NI 9263", "C_SERIES_MODULE", True),
        ("PCI-6704", "AO_SERIES", False),
    ],
)
def test_a_card_whose_outputs_cannot_take_the_clock_of_its_inputs_is_refused(
    card: Card, model: str, category: str, clocked: bool
) -> None:
    card.facts |= {
        "product_type": model,
        "product_category": ProductCategory[category],
        "ao_samp_clk_supported": clocked,
    }
    with pytest.raises(ModelError, match=rf"card 'Dev1' \({model}\) cannot use the clock of its"):
        NiAcquisition(SETUP, DaqmxBackend(card.library()))
    assert NiAcquisition(replace(SETUP, outputs=()), DaqmxBackend(card.library())).channel(1) > 0.0


def test_the_driver_has_the_last_word_on_the_route(card: Card, instrument: NiAcquisition) -> None:
    card.faults = {"AnalogMultiChannelWriter.write_many_sample": -89136}
    with pytest.raises(ControllerError, match="error -89136: the outputs of this card cannot use"):
        run_waveform(instrument, wave(), SIGNALS, rate_hz=1000.0)


def test_sensors_behind_a_multiplexer_say_when_they_are_sampled(card: Card) -> None:
    instrument = NiAcquisition(SETUP, DaqmxBackend(card.library()))
    assert "sampled" not in instrument.settings()["sensor x"]
    assert instrument.settings()["sensor roll"].endswith("sampled 11 us after the first sensor")
    card.facts["ai_simultaneous_sampling_supported"] = True
    at_once = NiAcquisition(SETUP, DaqmxBackend(card.library()))
    assert "sampled" not in str(at_once.settings())
    card.facts["ai_simultaneous_sampling_supported"] = False
    card.faults = {"Task.timing.ai_conv_rate": -200452}
    unknown = NiAcquisition(SETUP, DaqmxBackend(card.library()))
    assert unknown.settings()["sensor roll"].endswith("that the driver does not report")
    card.faults = {"Task.timing.ai_conv_rate": -201003}
    with pytest.raises(NotConnectedError, match="cannot be reached"):
        NiAcquisition(SETUP, DaqmxBackend(card.library()))
    assert all(t.state.closed for t in card.tasks)


def test_one_sample_is_put_out_twice(card: Card, instrument: NiAcquisition) -> None:
    backend = instrument._backend
    task = backend.open_output(SETUP.outputs[:1], np.array([[1.5]]), 5e3, clock=None)
    assert card.tasks[-1].state.samples.tolist() == [[1.5, 1.5]]
    task.close()


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
    names = {code: DAQmxErrors(code).name for code in daqmx.SENTENCES}
    assert names[-200279] == "SAMPLES_NO_LONGER_AVAILABLE"
    assert names[-50103] == "PAL_RESOURCE_RESERVED"
    assert names[-200170] == "PHYSICAL_CHAN_DOES_NOT_EXIST"
    assert names[-200290] == "GEN_STOPPED_TO_PREVENT_REGEN_OF_OLD_SAMPLES"
    assert names[-201003] == "DEV_CANNOT_BE_ACCESSED"
    assert names[-200019] == "ADC_OVERRUN"
    assert names[-200284] == "SAMPLES_NOT_YET_AVAILABLE"
    assert names[-89136] == "ROUTE_NOT_SUPPORTED_BY_HW_ROUTING"
    supported = {DAQmxErrors(code).name for code in daqmx.NOT_SUPPORTED}
    assert supported == {"ATTR_NOT_SUPPORTED", "ATTRIBUTE_NOT_SUPPORTED_IN_TASK_CONTEXT"}
    assert all(DAQmxErrors(code) for code in daqmx.GONE)


def test_with_a_driver_the_card_is_real_unless_asked_otherwise(
    card: Card, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(address, "driver_found", lambda: "")
    monkeypatch.setattr(address, "DaqmxBackend", lambda: DaqmxBackend(card.library()))
    real = open_address(
        "ni://Dev1?x=ao0,ai2&y=ao1,ai3&sensitivity=3um/V&sensitivity.y=7um/V&amplifier=1"
        "&terminal=rse&range.y=1V"
    )
    assert not real.identity.simulated
    assert real.channel(1) == pytest.approx(3e-6 * value("Dev1/ai2"))
    assert real.channel(2) == pytest.approx(7e-6 * value("Dev1/ai3"))
    made = [a for n, a in card.log if n.endswith("add_ai_voltage_chan")][-1]
    assert made["terminal_config"] == TerminalConfiguration.RSE
    assert (made["min_val"], made["max_val"]) == (-1.0, 1.0)
    assert open_address("ni://Dev1?x=ao0,ai2&simulated=1").identity.simulated
    # Nobody may guess what a real sensor reads for a volt.
    with pytest.raises(ModelError, match="sensitivity=10um/V"):
        open_address("ni://Dev1?x=ao0,ai2")
    with pytest.raises(
        ModelError, match=r"the sensitivity of sensor 'y': .*'sensitivity\.y=10um/V'"
    ):
        open_address("ni://Dev1?x=ao0,ai2&y=ao1,ai3&amplifier=1&sensitivity.x=3um/V")
    # Nor by what a drive gets more than the output gives.
    with pytest.raises(ModelError, match=r"of axis 'x': .*'amplifier=1' without one"):
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
