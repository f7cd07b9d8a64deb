"""Turns what a plan asks for into the samples of a command."""

import itertools
import math
from collections.abc import Callable, Mapping

import numpy as np

from flexstage.arrays import Array
from flexstage.errors import FlexstageError, PlanError
from flexstage.experiments.axis_limits import AxisSetting
from flexstage.experiments.command import CommandWaveform, Strike, require_size
from flexstage.experiments.excite import (
    BidirectionalTargets,
    Blows,
    Chirp,
    Corners,
    Designed,
    EqualCycles,
    Excite,
    Falling,
    Hold,
    Multisine,
    RisingSteps,
)
from flexstage.instruments.waveform import Waveform

#: A step from level to level lasts this long, or longer where the limits ask for it [s].
_STEP_TIME = 5e-3
#: Of a largest slew or speed, this share is used.
_OF_RATE = 0.8
#: Lines of a multisine and a chirp need this many samples in a cycle.
_SAMPLES_PER_CYCLE = 10.0
#: A rest lasts so much longer than the way to it, at least.
_REST_OVER_WAY = 1.5
#: Highest rate of samples of an instrument that nobody has asked [Hz].
BASE_RATE_HZ = 10e3
#: At that rate, small sines are made up to this share of it.
_HIGHEST = 0.35


def design_command(
    wanted: Excite,
    settings: Mapping[str, AxisSetting],
    sample_rate_hz: float,
    *,
    base_rate_hz: float = BASE_RATE_HZ,
) -> CommandWaveform | Strike:
    """Return the samples of a command.

    A faster rate is taken for small sines; every rate is a whole part of the base rate, the highest
    of the instrument [Hz].

    Examples
    --------
    >>> x = AxisSetting(axis="x", quantity="voltage", low=0.0, high=120.0)
    >>> made = design_command(EqualCycles(axis="x", rate=0.5, cycles=3), {"x": x}, 1000.0)
    >>> made.duration, made.first, float(made.waveform.values["x"].max())
    (8.001, 2000, 120.0)
    """
    if isinstance(wanted, Blows):
        return Strike(axis=wanted.axis, hits=wanted.hits)
    fs = whole_part(sample_rate_hz, base_rate_hz)
    makers: dict[type, Callable[..., CommandWaveform]] = {
        EqualCycles: _cycles,
        Falling: _falling,
        Designed: _designed,
        RisingSteps: _staircase,
        BidirectionalTargets: _positioning,
        Hold: _hold,
    }
    if isinstance(wanted, Corners):
        return _corners(wanted, [settings[a] for a in wanted.axes], fs)
    setting = settings[wanted.moved[0]]
    if isinstance(wanted, Multisine | Chirp):
        made = _small(wanted, setting, fs, base_rate_hz)
    else:
        made = makers[type(wanted)](wanted, setting, fs)
    require_size(made.waveform.size, wanted.kind)
    return made


def whole_part(rate_hz: float, base_rate_hz: float) -> float:
    """Return the rate nearest to another that is a whole part of the highest one.

    Examples
    --------
    >>> whole_part(3000.0, 10e3)
    3333.3333333333335
    """
    return base_rate_hz / max(round(base_rate_hz / rate_hz), 1)


def _command(setting: AxisSetting, values: Array, rate: float, **more: object) -> CommandWaveform:
    waveform = Waveform(
        values={setting.axis: values}, sample_rate_hz=rate, quantity=setting.quantity
    )
    return CommandWaveform(waveform=waveform, reference={}, **more)  # type: ignore[arg-type]


def _samples_of_cycle(kind: str, rate_hz: float, sample_rate_hz: float, cycles: float) -> int:
    n = round(sample_rate_hz / rate_hz)
    if n < _SAMPLES_PER_CYCLE:
        raise PlanError(
            f"cycles of {rate_hz:g} Hz need commands of {_SAMPLES_PER_CYCLE * rate_hz:g} samples a "
            f"second, got {sample_rate_hz:g}: raise command_rate"
        )
    require_size(n * cycles, kind)
    return n


def _cycles(w: EqualCycles, s: AxisSetting, fs: float) -> CommandWaveform:
    n = _samples_of_cycle(w.kind, w.rate, fs, w.cycles + w.condition)
    k = np.arange(int((w.cycles + w.condition) * n) + 1)
    phase = k / n
    if w.shape == "cosine":
        share = 0.5 - 0.5 * np.cos(2.0 * np.pi * phase)
    else:
        share = 1.0 - np.abs(2.0 * (phase % 1.0) - 1.0)
    low, high = s.place(w.low), s.place(w.high)
    return _command(s, low + (high - low) * share, fs, first=w.condition * n, period=n)


def _falling(w: Falling, s: AxisSetting, fs: float) -> CommandWaveform:
    before, whole = w.condition, w.full + w.falling
    n = _samples_of_cycle(w.kind, w.rate, fs, before + whole)
    cycle = np.arange(int((before + whole) * n) + 1) / n - before
    swing = np.interp(cycle, [0.0, w.full, whole], [1.0, 1.0, w.smallest])
    share = 0.5 - 0.5 * swing * np.cos(2.0 * np.pi * cycle)
    return _command(s, s.low + (s.high - s.low) * share, fs, first=int(before) * n, period=n)


def _designed(w: Designed, s: AxisSetting, fs: float) -> CommandWaveform:
    from flexstage.hysteresis import excitation

    if s.quantity != "voltage":
        raise PlanError(f"a designed record is for a piezo stack, and axis '{s.axis}' has none")
    try:
        made = excitation(
            (s.low, s.high),
            sample_rate_hz=fs,
            duration=w.duration,
            rates_hz=w.rates,
            slope_limit=s.largest_rate,
            natural_frequency_hz=s.natural_frequency_hz,
            resonance=w.resonance and s.natural_frequency_hz is not None,
            hold=w.hold,
            seed=w.seed,
        )
    except FlexstageError as error:
        raise PlanError(str(error)) from error
    return _command(s, made.voltage, fs, notes=made.warnings)


def _small(w: Multisine | Chirp, s: AxisSetting, fs: float, base: float) -> CommandWaveform:
    if s.quantity != "voltage":
        raise PlanError(
            f"small sines are for a piezo stack in open loop, and axis '{s.axis}' has none"
        )
    if w.band[1] > _HIGHEST * base:
        raise PlanError(
            f"a band up to {w.band[1]:g} Hz needs an instrument of {w.band[1] / _HIGHEST:g} "
            f"samples a second, got {base:g}"
        )
    # no slower than the usual rate, and fast enough for the highest line where it can be
    wanted = max(_SAMPLES_PER_CYCLE * w.band[1], fs)
    rate = base / max(math.floor(base / wanted), 1)
    n = round(w.period * rate)
    if n < 2.0 * _SAMPLES_PER_CYCLE:
        raise PlanError(
            f"a period of {w.period:g} s of the {w.kind} has {n} samples at {rate:g} Hz, and needs "
            f"{2.0 * _SAMPLES_PER_CYCLE:g} at least: make it longer"
        )
    require_size(n * (w.periods + 1), w.kind)
    if isinstance(w, Multisine):
        one = _multisine(w, n, rate)
    else:
        t = np.arange(n) / rate
        # up and down again, so that the next sweep goes on without a jump
        half = 0.5 * w.period
        climb = (w.band[1] - w.band[0]) / half
        up = np.minimum(t, w.period - t)
        phase = w.band[0] * up + 0.5 * climb * up**2
        total = w.band[0] * half + 0.5 * climb * half**2
        # whole half cycles each way, so that a period ends where it began
        whole = max(round(2.0 * total), 1) / (2.0 * total)
        phase, total = whole * phase, whole * total
        one = np.sin(2.0 * np.pi * np.where(t < half, phase, 2.0 * total - phase))
    middle = min(max(s.place(w.at), s.low + w.amplitude), s.high - w.amplitude)
    if middle < s.low + w.amplitude * (1.0 - 1e-9):
        raise PlanError(
            f"an amplitude of {w.amplitude:g} V does not fit into {s.low:g} to {s.high:g} V"
        )
    values = middle + w.amplitude * np.tile(one, w.periods + 1)
    return _command(s, np.append(values, values[0]), rate, first=n, period=n)


def _multisine(w: Multisine, n: int, rate: float) -> Array:
    lines = np.arange(math.ceil(w.band[0] * n / rate - 1e-9), math.floor(w.band[1] * n / rate) + 1)
    rng = np.random.default_rng(np.random.SeedSequence(w.seed, spawn_key=(7,)))
    best: Array | None = None
    # of some draws that with the lowest crest has most power for its amplitude
    for _ in range(32):
        spectrum = np.zeros(n // 2 + 1, dtype=np.complex128)
        spectrum[lines] = np.exp(2j * np.pi * rng.random(lines.size))
        x = np.fft.irfft(spectrum, n)
        x /= np.max(np.abs(x))
        if best is None or np.mean(x**2) > np.mean(best**2):
            best = x
    assert best is not None
    return best


def _levels(
    kind: str, s: AxisSetting, levels: Array, dwell: float, fs: float, settle: float = 0.0
) -> tuple[Array, int]:
    """Return samples of rests with straight ways between them, and the samples of one rest."""
    rest = max(round(dwell * fs), 4)
    wait = round(settle * fs)
    largest = float(np.max(np.abs(np.diff(levels)), initial=0.0))
    way = round(_STEP_TIME * fs)
    if s.largest_rate is not None:
        way = max(way, math.ceil(largest / (_OF_RATE * s.largest_rate) * fs))
    way = max(way, 1)
    require_size(wait + levels.size * (rest + way), kind)
    parts = [np.full(wait + rest, levels[0])]
    for a, b in itertools.pairwise(levels):
        parts.append(a + (b - a) * np.arange(1, way) / way)
        parts.append(np.full(rest, b))
    return np.concatenate(parts), wait


def _staircase(w: RisingSteps, s: AxisSetting, fs: float) -> CommandWaveform:
    height = w.advance if s.quantity == "position" else w.step
    if height is None and s.quantity == "position":
        height = s.smallest_step
    if height is None:
        what = "'step' in volts" if s.quantity == "voltage" else "'advance' in metres"
        raise PlanError(f"the staircase of axis '{s.axis}' needs its {what}")
    top = s.place(w.at) + height * (w.levels - 1)
    if top > s.high * (1.0 + 1e-12):
        raise PlanError(
            f"the staircase of axis '{s.axis}' would end at {_text(top, s)}, and its range ends at "
            f"{_text(s.high, s)}: begin lower, or take smaller or fewer steps"
        )
    levels = s.place(w.at) + height * np.arange(w.levels, dtype=np.float64)
    samples, wait = _levels(w.kind, s, levels, w.dwell, fs, w.settle)
    return _command(s, samples, fs, first=wait)


def _positioning(w: BidirectionalTargets, s: AxisSetting, fs: float) -> CommandWaveform:
    if s.quantity != "position":
        raise PlanError(f"targets are positions, and axis '{s.axis}' is commanded by voltage")
    rise = np.linspace(s.place(w.low), s.place(w.high), w.targets)
    # one level beyond each end, so that the end targets too are gone to from both sides
    beyond = 0.5 * min(w.low, 1.0 - w.high, 0.1) * (s.high - s.low)
    first, last = rise[0] - beyond, rise[-1] + beyond
    once = np.concatenate(([first], rise, [last], rise[::-1]))
    dwell = w.dwell
    if s.largest_rate is not None:
        # it is told from a ramp by resting for most of the time
        dwell = max(dwell, _REST_OVER_WAY * (rise[1] - rise[0]) / (_OF_RATE * s.largest_rate))
    require_size(once.size * w.rounds * dwell * fs, w.kind)
    samples, _ = _levels(w.kind, s, np.append(np.tile(once, w.rounds), first), dwell, fs)
    return _command(s, samples, fs)


def _hold(w: Hold, s: AxisSetting, fs: float) -> CommandWaveform:
    wait, n = round(w.settle * fs), max(round(w.duration * fs), 2)
    require_size(wait + n, w.kind)
    return _command(s, np.full(wait + n, s.place(w.at)), fs, first=wait)


def _corners(w: Corners, settings: list[AxisSetting], fs: float) -> CommandWaveform:
    if len({s.quantity for s in settings}) > 1:
        raise PlanError("corners need two axes that are commanded in the same way")
    rest, way = max(round(w.dwell * fs), 4), max(round(w.travel * fs), 1)
    for s in settings:
        span = s.place(w.high) - s.place(w.low)
        if s.largest_rate is not None:
            way = max(way, math.ceil(span / (_OF_RATE * s.largest_rate) * fs))
    require_size(4 * (w.rounds + 1) * (rest + way), w.kind)
    shares = ((0, 1, 1, 0), (0, 0, 1, 1))
    number: list[Array] = []
    samples: tuple[list[Array], list[Array]] = ([], [])
    visits = 4 * (w.rounds + 1)
    for v in range(visits):
        for axis, s in enumerate(settings):
            a, b = (s.place((w.low, w.high)[shares[axis][(v + j) % 4]]) for j in (0, 1))
            samples[axis].append(np.full(rest, a))
            samples[axis].append(a + (b - a) * np.arange(1, way + 1) / way)
        counted = np.full(rest + way, -1.0)
        counted[rest // 2 : rest] = v % 4
        number.append(counted)
    waveform = Waveform(
        values={s.axis: np.concatenate(v) for s, v in zip(settings, samples, strict=True)},
        sample_rate_hz=fs,
        quantity=settings[0].quantity,
    )
    # the first round brings both axes into the memory that all later ones share
    first = 4 * (rest + way)
    return CommandWaveform(
        waveform=waveform, first=first, reference={}, corner=np.concatenate(number)
    )


def _text(value: float, s: AxisSetting) -> str:
    return f"{value:g} V" if s.quantity == "voltage" else f"{1e6 * value:g} um"
