"""Runs that are recorded: waveforms, holds, blows and moves, on any instrument.

The samples are read while they are recorded and handed to a writer at once, so that what was
recorded before a link was lost, or a program died, is kept.
"""

from collections.abc import Sequence

import numpy as np

from flexstage import progress
from flexstage.errors import LimitError, ModelError
from flexstage.instruments.checks import check_position, check_waveform
from flexstage.instruments.protocol import Capability, Instrument, Signal
from flexstage.instruments.ramp import lead_to, require_loop
from flexstage.instruments.recorded_run import RecordedRun, SampleWriter
from flexstage.instruments.waveform import Waveform
from flexstage.records import Channel, Record


def run_waveform(
    instrument: Instrument,
    waveform: Waveform,
    signals: Sequence[Signal],
    *,
    rate_hz: float,
    cycles: int = 1,
    feedforward: Waveform | None = None,
    writer: SampleWriter | None = None,
    before: int = 0,
    after: int = 0,
    timeout: float | None = None,
) -> Record:
    """Run a waveform and record what happens.

    The whole waveform is checked before anything moves; the axes are led slowly to its first
    sample; the recorder starts with the waveform, so that sample 0 of the record is the instant of
    sample 0 of the waveform.

    Parameters
    ----------
    instrument : Instrument
        What runs it. Whether the position control is on must fit to the waveform.
    waveform : Waveform
        Voltages with the position control off, or positions with it on.
    signals : sequence of Signal
        What is recorded.
    rate_hz : float
        Samples in a second [Hz]; the record says which rate the instrument could keep.
    cycles : int
        How often the waveform runs.
    feedforward : Waveform, optional
        Voltages beside a waveform of positions.
    writer : SampleWriter, optional
        Is handed the samples as they come.
    before : int
        Samples before the waveform; with some, the recorder is started first, and how many they
        became is only known to the reaction of the link: the notes of the record say so.
    after : int
        Samples after the end of the waveform.
    timeout : float, optional
        How long to wait for the record beyond its own duration [s]; 10 s and half of that duration
        where not given.

    Returns
    -------
    Record
        The signals, with the time from the first sample of the record [s].

    Raises
    ------
    LimitError
        The waveform leaves the limits, or the record does not fit; nothing has been moved.
    ModelError
        The feedforward is not of voltages, or signals share a name; nothing has been moved.
    ControllerError
        The instrument refuses, a sensor gives no number, or the record does not come to its end;
        the stage was stopped.
    NotConnectedError
        The link was lost; the sentence says how many samples are safe.
    """
    if cycles < 1:
        raise LimitError(f"a recorded waveform runs 1 time or more, got {cycles}")
    if before < 0 or after < 0:
        raise ModelError(f"samples before and after cannot be negative, got {before} and {after}")
    limits = {name: axis.limits for name, axis in instrument.axes.items()}
    check_waveform(limits, waveform, cycles=cycles)
    if feedforward is not None:
        if (waveform.quantity, feedforward.quantity) != ("position", "voltage"):
            raise ModelError(
                "a feedforward is of voltages beside a waveform of positions, got "
                f"{feedforward.quantity} beside {waveform.quantity}"
            )
        check_waveform(limits, feedforward, cycles=cycles)
    first = {name: float(values[0]) for name, values in waveform.values.items()}
    require_loop(instrument, first, waveform.quantity)
    duration = waveform.duration * cycles

    def samples(rate: float) -> int:
        return max(round(duration * rate), 2) + before + after

    run = RecordedRun(instrument, signals, writer)
    run.configure(rate_hz, samples)  # what cannot be recorded shows before anything moves
    with run.stopping():
        lead_to(instrument, first, waveform.quantity)
        waves = instrument.waves
        waves.load(waveform, feedforward=feedforward)
        run.configure(rate_hz, samples)
        if before:
            instrument.recorder.start()
            run.read(timeout, until=before)
            run.notes.append(
                f"the waveform was started after {before} samples or a little more, as fast as the "
                "link allowed"
            )
            waves.start(cycles)
        else:
            instrument.recorder.arm()
            waves.start(cycles)
        run.read(timeout)
        run.wait(waves.running, "the waveform", timeout)
    return run.record()


def record_now(
    instrument: Instrument,
    signals: Sequence[Signal],
    rate_hz: float,
    samples: int,
    writer: SampleWriter | None = None,
    *,
    timeout: float | None = None,
) -> Record:
    """Record while the instrument does what it does, such as to hold its place.

    Parameters
    ----------
    instrument : Instrument
        What records.
    signals : sequence of Signal
        What is recorded.
    rate_hz : float
        Samples in a second [Hz].
    samples : int
        How many, 2 at least.
    writer : SampleWriter, optional
        Is handed the samples as they come.
    timeout : float, optional
        As of `run_waveform` [s].

    Returns
    -------
    Record
        The signals.

    Raises
    ------
    ControllerError, NotConnectedError
        As of `run_waveform`.
    """
    run = RecordedRun(instrument, signals, writer)
    with run.stopping():
        run.configure(rate_hz, lambda _: samples)
        instrument.recorder.start()
        run.read(timeout)
    return run.record()


def record_blow(
    instrument: Instrument,
    axis: str,
    signals: Sequence[Signal],
    rate_hz: float,
    samples: int,
    writer: SampleWriter | None = None,
    *,
    timeout: float | None = None,
) -> Record:
    """Record a blow of the hammer along an axis."""
    if Capability.IMPACT not in instrument.capabilities:
        raise ModelError(
            f"the {instrument.identity.model} has no hammer: strike the stage by hand and read "
            "the record of the hammer's own instrument"
        )
    run = RecordedRun(instrument, signals, writer)
    with run.stopping():
        run.configure(rate_hz, lambda _: samples)
        instrument.recorder.arm()
        instrument.strike(axis)
        run.read(timeout)
    return run.record()


def run_moves(
    instrument: Instrument,
    axis: str,
    positions: Sequence[float],
    dwell: float,
    signals: Sequence[Signal],
    *,
    rate_hz: float,
    settle: float = 0.1,
    command: str = "command",
    writer: SampleWriter | None = None,
    timeout: float | None = None,
) -> Record:
    """Move an axis from place to place and record while it stands at each of them.

    For instruments without a generator of waveforms, and for drives that are slow.
    """
    if not len(positions):
        raise ModelError("moves need at least one position, got none")
    require_loop(instrument, {axis: 0.0}, "position")
    mover = instrument.axes[axis]
    for position in positions:
        check_position(mover.limits, position, axis)
    parts: list[Record] = []
    done = 0
    for k, position in enumerate(positions):
        with progress.subtask(k / len(positions), (k + 1) / len(positions)):
            run = RecordedRun(
                instrument, signals, writer, first=done, extra=(command, float(position))
            )
            with run.stopping():
                mover.move_to(float(position))
                instrument.pause(settle)
                run.configure(rate_hz, lambda rate: max(round(dwell * rate), 2))
                instrument.recorder.start()
                run.read(timeout)
            parts.append(run.record())
            done += parts[-1].size
    rate = parts[0].sample_rate_hz
    return Record(
        channels=tuple(
            Channel(
                name=c.name, values=np.concatenate([p.channel(c.name).values for p in parts]),
                unit=c.unit,
            )
            for c in parts[0].channels
        ),
        time=np.arange(done) / rate,
        source=parts[0].source,
        notes=(*parts[0].notes, "the motion from place to place is left out of the time"),
        attributes=parts[0].attributes,
    )  # fmt: skip
