r"""A set of measured responses: repetitions, shifted frequencies and errors, on dense lines.

The set has every repeated measurement :math:`P(f)`, those with all frequencies shifted, and those
that differ by the radius r(f) of their uncertainty in eight directions,
:math:`P + r\,e^{j(\arg P + n\pi/4)}`. No model is fitted. Between two measured lines 1/P is a
straight line where the phase falls, which is close to one mode, else P is, which is close to a
zero.
"""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from flexstage.base.arrays import Array, Complex
from flexstage.base.errors import ModelError
from flexstage.control.design import Requirements
from flexstage.control.loop_plant import LoopPlant, blocked_force
from flexstage.hysteresis import StageModes
from flexstage.measure.requests import TuneRequest
from flexstage.measure.spectra.response import MeasuredResponse
from flexstage.stage import Stage
from flexstage.system.mechanical import MechanicalSystem
from flexstage.system.modes import modes


@dataclass(frozen=True, slots=True)
class _Grid:
    """Interpolation of responses."""

    turn: float = math.radians(3.0)
    """Largest turn of the response between two lines after interpolation."""
    ratio: float = 0.02
    """Largest logarithm of the ratio of two frequencies."""
    directions: int = 8
    """Directions of the uncertainty in the complex plane."""
    shifts: int = 5
    """Shifts of the frequencies over their range."""
    slow: float = 2e-4
    """Lowest line of the response of a stage, over its first mode."""
    spread: int = 300
    """Number of its lines from there up, ..."""
    near: int = 81
    """... and of more about each mode, ..."""
    widths: float = 12.0
    """... over this many half widths."""


_GRID = _Grid()


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Member:
    """One response of a set, dense in frequency, without the delay of the loop."""

    name: str
    """Name."""
    frequency_hz: Array
    """Frequencies, rising [Hz]."""
    response: Complex
    """Reading over voltage."""
    force: Complex | None = None
    """Compression of the stack over voltage; None without a sensor in line with it."""
    measured: bool = True
    """True for a measurement, False for one with an error added."""


def stage_response(
    stage: Stage,
    system: MechanicalSystem,
    axes: Sequence[str],
    rate_hz: float,
    *,
    force: bool = False,
) -> MeasuredResponse:
    """Return the response of axes to the voltages of a sampled control, drives in place.

    It is exact with the hold, and without delay, up to half the rate of the control [Hz]. With
    `force`, the compression of the first stack is one more output. The lines are dense about each
    mode. Validity: linear about one position, without hysteresis, creep and amplifier.
    """
    highest_hz = 0.5 * rate_hz
    every = modes(system, drives="in place", count=None)
    ports = [system.drive(stage.drive_of(axis).name) for axis in axes]
    volts = [blocked_force(stage, system, port.name) for port in ports]
    probes = [stage.probe(stage.axis(axis).probe) for axis in axes]
    readers = [system.probe(probe.name).vector for probe in probes]
    inside = every.frequency_hz < highest_hz
    if not inside.any():
        raise ModelError(
            f"the first mode, {every.frequency_hz[0]:.4g} Hz, is above half the rate of the loop, "
            f"{highest_hz:g} Hz: raise --servo-rate"
        )
    s = np.sinh(np.linspace(-4.0, 4.0, _GRID.near)) / np.sinh(4.0)
    lines = [np.geomspace(_GRID.slow * every.frequency_hz[0], highest_hz, _GRID.spread)]
    for mode, zeta in zip(every.frequency_hz[inside], every.damping_ratio[inside], strict=True):
        lines.append(mode * (1.0 + min(_GRID.widths * max(zeta, 1e-4), 0.9) * s))
    f = np.unique(np.concatenate(lines))
    f = f[f <= highest_hz]
    if force:
        readers.append(-(ports[0].stiffness or 0.0) * ports[0].vector)
    forces = [volt * port.vector for volt, port in zip(volts, ports, strict=True)]
    shapes = every.shapes / every.omega
    static = (np.array(readers) @ shapes)[:, None] * (np.array(forces) @ shapes)
    response = static @ np.array([_sampled_mode(*row, rate_hz, f) for row in zip(
        every.frequency_hz.tolist(), every.damping_ratio.tolist(), strict=True)])  # fmt: skip
    if force:
        response[-1, 0] += volts[0]
    return MeasuredResponse(
        frequency_hz=f,
        response=response.transpose(2, 0, 1),
        inputs=tuple(port.name for port in ports),
        outputs=(*(probe.name for probe in probes), *(("force",) if force else ())),
        input_units=("V",) * len(ports),
        output_units=(*(probe.unit for probe in probes), *(("N",) if force else ())),
        source=f"{stage.name} ({system.model})",
    )


def _sampled_mode(mode_hz: float, damping: float, rate_hz: float, f: Array) -> Complex:
    mode = StageModes(frequency_hz=[mode_hz], damping_ratio=[damping])
    unit = LoopPlant(gain=1.0, gain_range=(1.0, 1.0), modes=mode, sample_rate_hz=rate_hz)
    return unit.response(f)


def unit_of(response: MeasuredResponse) -> str:
    """Return the unit of a response, empty if unknown."""
    above, below = response.output_units, response.input_units
    return f"{above[0]}/{below[0]}" if above and below and above[0] and below[0] else ""


def response_set(
    responses: Sequence[MeasuredResponse], request: TuneRequest
) -> tuple[list[Member], list[Member], tuple[str, ...]]:
    """Return the measurements on their lines, the set on dense lines, and its origin."""
    columns: list[tuple[str, MeasuredResponse, int]] = []
    by_force = request.control == "iff"
    for response in responses:
        outputs = len(response.outputs)
        if by_force and (outputs, len(response.inputs)) != (2, 1):
            raise ModelError(
                f"iff needs two responses of '{response.source}' to one voltage, that of the "
                "position and then that of the force of the stack, as --output names them; got "
                f"{outputs} of {len(response.inputs)}"
            )
        outputs -= by_force
        if len(response.inputs) > 1 or (outputs > 1 and not request.repeated):
            names = ", ".join(itertools.starmap("{}/{}".format, itertools.product(
                response.outputs, response.inputs)))  # fmt: skip
            raise ModelError(
                f"'{response.source}' has several responses ({names}): choose one by --response, "
                "--input and --output, or say --repeated if they repeat one measurement"
            )
        for o in range(outputs):
            columns.append((f"{response.source} {response.outputs[o]}".strip(), response, o))
    single = len(columns) == 1
    shifts = shifts_of(request, single=single)
    shift = float(shifts[-1])
    measured, members, origins = [], [], []
    for name, response, o in columns:
        highest = 0.5 * request.servo_rate
        inside = (response.frequency_hz > 0.0) & (response.frequency_hz <= highest)
        inside &= response.response[:, o, 0] != 0.0
        if inside.sum() < 2:
            raise ModelError(
                f"the response '{name}' has fewer than two lines below half the rate of the loop, "
                f"{request.servo_rate:g} Hz: raise --servo-rate"
            )
        one = response.lines(inside)
        f, h = one.frequency_hz, one.response[:, o, 0]
        force = one.response[:, 1, 0] if by_force else None
        radius, origin = _radius(one, o, request, single)
        # the same one of reading and force
        common = by_force and bool(radius.any())
        origins.append(origin + (", of the drive, without noise of the force" if common else ""))
        measured.append(Member(name=name, frequency_hz=f, response=h, force=force))
        factors = [(0j, "")]
        if radius.any():
            angles = np.arange(_GRID.directions) * 2.0 * np.pi / _GRID.directions
            factors += [(np.exp(1j * a), f", error at {math.degrees(a):.0f} deg") for a in angles]
        dense, values = dense_response(f, one.response[:, [o, 1] if by_force else [o], 0])
        relative = np.interp(dense, f, radius / np.abs(h))
        for s, (factor, error) in itertools.product(shifts.tolist(), factors):
            shifted = f", frequencies {100.0 * s:+.2g} %" if s else ""
            below = (1.0 + s) * dense <= highest
            erred = (values * (1.0 + relative * factor)[:, None])[below].T
            members.append(
                Member(
                    name=name + shifted + error,
                    frequency_hz=(1.0 + s) * dense[below],
                    response=erred[0],
                    force=erred[1] if by_force else None,
                    measured=not (error or shifted),
                )
            )
    count = "one measurement" if single else f"{len(columns)} measurements"
    notes = [f"set of {len(members)} responses: {count}; {'; '.join(dict.fromkeys(origins))}"]
    if shift:
        notes.append(f"all frequencies may be {100.0 * shift:.3g} % off (--shift)")
    return measured, members, tuple(notes)


def shifts_of(request: TuneRequest, *, single: bool) -> Array:
    """Return the relative shifts of all frequencies."""
    assumed = Requirements().frequency_scatter if single else 0.0
    shift = assumed if request.shift is None else request.shift
    return np.linspace(-shift, shift, _GRID.shifts if shift else 1)


def _radius(
    response: MeasuredResponse, o: int, request: TuneRequest, single: bool
) -> tuple[Array, str]:
    """Return the radius of the uncertainty at each line, and its origin in words."""
    size = np.abs(response.response[:, o, 0])
    if request.uncertainty is not None:
        share = request.uncertainty
        return share * size, f"relative uncertainty of {100.0 * share:.3g} % by --uncertainty"
    wide = math.sqrt(-math.log(1.0 - request.coverage))
    covered = f"{100.0 * request.coverage:.4g} % coverage at each line"
    if response.variance is not None:
        return wide * np.sqrt(response.variance[:, o, 0]), f"error by its variance, {covered}"
    if response.coherence is not None:
        averages = response.averages or request.averages
        coherence = np.clip(response.coherence[:, o], 1e-9, 1.0)
        variance = size**2 * (1.0 - coherence) / (coherence * averages)
        return (
            wide * np.sqrt(variance),
            f"error by coherence, averages: {averages:g}, {covered}",
        )
    if not single:
        return np.zeros_like(size), "scatter of the repetitions alone"
    share = Requirements().gain_scatter
    origin = f"relative uncertainty of {100.0 * share:.3g} %, as the file has none (--uncertainty)"
    return share * size, origin


def dense_response(
    f: Array, responses: Complex, steepest: float = math.pi
) -> tuple[Array, Complex]:
    """Return responses, shape (k, m), at lines close enough for straight lines.

    A larger fall of the phase than the steepest [rad] is noise, and not the circle of a mode. Axes
    without coupling have responses of zero, which have no phase.
    """
    some = (responses[1:] != 0.0) & (responses[:-1] != 0.0)
    ratio = np.divide(responses[1:], responses[:-1], out=np.ones_like(responses[1:]), where=some)
    turn = np.angle(ratio)
    widest = np.abs(turn).max(axis=1)
    parts = np.maximum(widest / _GRID.turn, np.log(f[1:] / f[:-1]) / _GRID.ratio)
    count = np.ceil(parts).astype(int).clip(1)
    at = np.repeat(np.arange(count.size), count)
    share = np.concatenate([np.arange(n) / n for n in count.tolist()])
    dense = np.append(f[at] + share * (f[at + 1] - f[at]), f[-1])
    here, there, along = responses[at], responses[at + 1], share[:, None]
    straight = here + along * (there - here)
    with np.errstate(divide="ignore", invalid="ignore"):
        inverse = 1.0 / (1.0 / here + along * (1.0 / there - 1.0 / here))
    falls = (turn < 0.0) & (turn >= -steepest)
    values = np.where(falls[at], inverse, straight)
    return dense, np.append(values, responses[-1:], axis=0)


def require_band(member: Member, request: TuneRequest) -> None:
    """Refuse a response that does not begin below its resonances, or ends below one."""
    f, first = member.frequency_hz, member.response[0]
    phase = float(np.angle(first))
    if abs(phase) > math.pi - request.phase_step:
        raise ModelError(
            f"the reading falls as the voltage rises (phase {math.degrees(phase):.0f} deg at "
            f"{f[0]:.4g} Hz): reverse the sign of the response"
        )
    if abs(phase) > request.phase_step:
        raise ModelError(
            f"the phase at the lowest line, {f[0]:.4g} Hz, is {math.degrees(phase):.0f} deg: the "
            "response of a stage with a stiffness begins near 0, so measure from a lower frequency"
        )
    size, scatter = np.abs(member.response), 1.0 + Requirements().gain_scatter
    if size[-1] > scatter * size[0] and scatter * size[-1] > size.max():
        raise ModelError(
            f"the response is largest at its end, {size[-1] / size[0]:.3g} times that at "
            f"{f[0]:.4g} Hz, as below a resonance above {f[-1]:.4g} Hz: measure beyond it, with a "
            "--servo-rate of more than twice its frequency"
        )


def surrogate(member: Member, request: TuneRequest) -> LoopPlant:
    """Return a plant with the peaks and delay of a response, for candidates of controls only."""
    f, h = member.frequency_hz, member.response
    size = np.abs(h)
    peaks = highest_peaks(f, size, request.notches)
    low = f <= (0.1 * peaks[0][0] if peaks else f[-1])
    low[0] = True
    delay = float(np.median(-np.angle(h[low]) / (2.0 * np.pi * f[low])))
    gain = float(size[0])
    modes = None
    if peaks:
        frequencies, damping, heights = zip(*sorted(peaks), strict=True)
        share = tuple(2.0 * z * h / gain for z, h in zip(damping, heights, strict=True))
        modes = StageModes(frequency_hz=frequencies, damping_ratio=damping, share=share)
    return LoopPlant(
        gain=gain,
        gain_range=(gain, gain),
        modes=modes,
        delay=max(delay, 0.0) + request.latency,
        sample_rate_hz=request.servo_rate,
    )


def highest_peaks(f: Array, size: Array, count: int) -> list[tuple[float, float, float]]:
    """Return frequency, damping ratio by half power, and height of the highest peaks.

    A peak has lines of half its power on both sides.
    """
    peaks = []
    for k in np.flatnonzero((size[1:-1] > size[:-2]) & (size[1:-1] >= size[2:])) + 1:
        half = size[k] / math.sqrt(2.0)
        left, right = np.flatnonzero(size[:k] < half), np.flatnonzero(size[k:] < half)
        if not (left.size and right.size):
            continue
        a, b = int(left[-1]), k + int(right[0])
        if size[a:b].max() > size[k]:
            continue
        below = np.interp(half, size[a : a + 2], f[a : a + 2])
        above = np.interp(half, size[[b, b - 1]], f[[b, b - 1]])
        peaks.append((float(f[k]), float(0.5 * (above - below) / f[k]), float(size[k])))
    # highest in a loop with an integral
    return sorted(peaks, key=lambda peak: -peak[2] / peak[0])[:count]


def strongest_mode(plant: LoopPlant) -> tuple[float, float, float]:
    """Return frequency [Hz], damping ratio and share of the mode that limits an integral loop."""
    if plant.modes is None:
        raise ModelError(
            "active damping needs a resonance below half the rate of the loop, and the response "
            "has none: raise --servo-rate, measure further up, or choose another --control"
        )
    rows = zip(plant.modes.frequency_hz, plant.modes.damping_ratio, plant.modes.share, strict=True)
    return max(rows, key=lambda row: abs(row[2]) / (row[1] * row[0]))


def force_zero(member: Member, mode_hz: float) -> tuple[float, float]:
    """Return the frequency of the zero of a force below a mode [Hz], and the static force [N/V]."""
    assert member.force is not None
    f, real = member.frequency_hz, member.force.real
    if not real[0] > 0.0:
        raise ModelError(
            "the force does not rise with the voltage at the lowest line: iff needs the "
            "compression of the stack, positive, by a sensor in line with it"
        )
    # the real part, since the hold adds a small phase to a force without delay
    below = np.flatnonzero((real[:-1] > 0.0) & (real[1:] <= 0.0) & (f[1:] < mode_hz))
    if not below.size:
        raise ModelError(
            f"the force has no zero below the mode at {mode_hz:.4g} Hz: iff needs a sensor in line "
            "with the stack (collocated), and a stack that is not too soft for the stage"
        )
    k = int(below[-1])
    share = real[k] / (real[k] - real[k + 1])
    return float(f[k] + share * (f[k + 1] - f[k])), float(real[0])
