"""The opening comment of a header for real time: what a step costs, how far rounding takes it.

And samples of commands and readings with which a target is checked.
"""

import textwrap

import numpy as np

from flexstage.base.version import __version__
from flexstage.export.source.model_numbers import c_comment, lag_rates
from flexstage.hysteresis.dynamic_model import DynamicModel, ModelDrive, ModelProbe
from flexstage.hysteresis.model import Array

#: Roundings of a step over the largest force: six terms of the size of the force in deflection and
#: in rate, each with the rounding of its factor, its product and three sums.
ROUNDINGS = 42.0
# of a step of a lag, whose losses are carried, over what a step adds
_LAG_ROUNDINGS = ROUNDINGS
_SINGLE = 2.0**-24


def opening(model: DynamicModel, prefix: str, *, single: bool) -> str:
    """Return the comment that a header begins with."""
    big = prefix.upper()
    lines = [
        f"{prefix}.h: flexure stage {model.name}, stepped in real time.",
        "",
        *_wrapped(model.title),
        f"Written by flexstage {__version__}.",
        "",
        f"Commands, in this order ({big}_DRIVES = {len(model.drives)}):",
        *(f"  [{i}] {line}" for i, d in enumerate(model.drives) for line in [_drive(d)]),
        "",
        f"Readings, in this order ({big}_PROBES = {len(model.probes)}):",
        *(f"  [{i}] {line}" for i, p in enumerate(model.probes) for line in [_probe(p)]),
        "",
        f"Step: {model.step:.9g} s ({1.0 / model.step:.6g} Hz), fixed; commands move on straight "
        "lines.",
        f"Modes: {model.omega.size}, {model.omega[0] / (2.0 * np.pi):.4g} to "
        f"{model.omega[-1] / (2.0 * np.pi):.4g} Hz, drives in place.",
        "",
        "How to call it:",
        f'  #include "{prefix}.h"',
        f"  static {prefix}_stage stage;",
        f"  {prefix}_real commands[{big}_DRIVES], readings[{big}_PROBES];",
        f"  {prefix}_init(&stage);                            once; at rest at zero commands",
        f"  {prefix}_settle(&stage, commands);                where it stands elsewhere",
        f"  {prefix}_step(&stage, commands, readings);        once a step; 0, or a message",
        f"  {prefix}_self_test(&stage);                       then init or settle again",
        "",
        *_wrapped(
            "No allocation, no input or output, no recursion, no library but libm; nothing global "
            "that changes, so that instances are independent. A copy of an instance's bytes is a "
            "saved state. C99, or C++11."
        ),
        "",
        *_wrapped(
            f"Cost of a step: about {operations(model)} additions and multiplications; "
            f"{state_numbers(model)} numbers are remembered. An instance takes "
            f"sizeof({prefix}_stage) bytes with its tables, the constants about as many again. At "
            "rest at exactly zero the modes die away to numbers below the smallest normal one; "
            "where the processor is slow at these, let it flush them to zero."
        ),
        "",
        *_accuracy(model, single=single),
        "",
        "Validity:",
        *(line for note in model.notes for line in _wrapped(note, first="- ", rest="  ")),
    ]
    return (
        "/* " + "\n * ".join(c_comment(line) for line in lines).replace(" * \n", " *\n") + "\n */\n"
    )


def _wrapped(text: str, first: str = "", rest: str = "") -> list[str]:
    return textwrap.wrap(
        text, 92, initial_indent=first, subsequent_indent=rest, break_on_hyphens=False
    ) or [""]


def _drive(d: ModelDrive) -> str:
    words = []
    if d.input_range is not None:
        words.append(f"{d.input_range[0]:g} to {d.input_range[1]:g} {d.unit}")
    if d.amplifier is not None:
        words.append(f"amplifier {d.amplifier.bandwidth_hz:g} Hz")
    if d.hysteresis is not None:
        words.append(f"hysteresis {d.hysteresis.kind}")
    elif d.unit == "V":
        words.append(f"{d.gain:.6g} m/V")
    if d.creep is not None and d.hysteresis is not None:
        words.append(f"creep {100.0 * d.creep.rate_per_decade:.3g} % a decade")
    if d.stiffness is None:
        words.append("displacement imposed")
    return f"{d.name} [{d.unit}], {d.kind}" + (": " + ", ".join(words) if words else "")


def _probe(p: ModelProbe) -> str:
    if p.sensor is None:
        return f"{p.name} [{p.unit}], true motion"
    words = [f"gain {p.sensor.gain:g}", f"offset {p.sensor.offset:g}"]
    if p.sensor.bandwidth_hz is not None:
        words.append(f"{p.sensor.bandwidth_hz:g} Hz")
    if p.sensor.quantisation > 0.0:
        words.append(f"steps of {p.sensor.quantisation:g}")
    return f"{p.name} [{p.unit}], sensor: " + ", ".join(words)


def _accuracy(model: DynamicModel, *, single: bool) -> list[str]:
    if not single:
        return _wrapped(
            "Accuracy: double precision. Compiled without contraction of products and sums "
            "(-ffp-contract=off) and without fast mathematics, and with the libm of the same "
            "system, readings are those of flexstage stepped one sample at a time, bit for bit "
            "where the hysteresis has a closed form; else to about 1e-12 of the stroke."
        )
    bound = rounding_bound(model)
    said = ", ".join(
        f"{p.name} {b:.2g} {p.unit}" for p, b in zip(model.probes, bound.tolist(), strict=True)
    )
    words = (
        "Accuracy: single precision. Rounding errors of all steps together stay below "
        f"{said}: {ROUNDINGS:g} u/(1 - exp(-zeta omega h)) of each mode's part, u = 6e-8; what is "
        "seen is some hundred times less. Not for commands that excite a mode of small damping for "
        "long (its amplification comes on top). Compile without fast mathematics."
    )
    if any(d.hysteresis is not None for d in model.drives):
        words += (
            " A hysteresis also rounds its memory in every step: N steps all one way put it off by "
            "up to N u/2 of itself; seen is a twentieth of that, 1e-3 of the stroke in a ramp of "
            "2.5 million steps. For ramps of minutes take double precision."
        )
    return _wrapped(words)


def operations(model: DynamicModel) -> int:
    """Return about how many additions and multiplications a usual step takes.

    In a usual one no hysteresis changes its branch.
    """
    k, probes = model.omega.size, len(model.probes)
    total = 0
    for d in model.drives:
        lags = lag_rates(d).size
        # transition and moments, rates to samples and back, readings
        total += k * (20 + 2 + 4 * probes) + 2 * lags * probes + 2 * probes
        if d.hysteresis is None:
            total += 2 * k
            continue
        # nine derivatives of an exponential that falls by some hundredths in a step
        total += k * 2 * 8 + lags * (2 * 9 + 6) + 100
    return int(round(total, -1))


def state_numbers(model: DynamicModel) -> int:
    """Return how many numbers the model remembers from step to step.

    Deflections and rates of each drive's modes, lags, hysteresis, amplifier, sensors.
    """
    total = 0
    for d in model.drives:
        memory = 1 if d.hysteresis is None else int(np.size(d.hysteresis.initial_state()))
        total += 2 * model.omega.size + lag_rates(d).size + memory + 3
    return total + sum(3 for p in model.probes if p.sensor is not None)


def command_span(model: DynamicModel, drive: ModelDrive) -> tuple[float, float]:
    """Return between what a drive may well be commanded [unit of the command].

    Its range where that is known, else its stroke or largest force to both sides, else 10 um or
    1 N.
    """
    if drive.input_range is not None:
        return drive.input_range
    port = model.system.drive(drive.name)
    size = port.largest_force if drive.unit == "N" else port.stroke
    if not size:
        size = 1.0 if drive.unit == "N" else 1e-5
    if drive.unit == "V" and drive.gain != 0.0:
        size = abs(size / drive.gain)
    return -size, size


def check_samples(model: DynamicModel) -> tuple[Array, Array]:
    """Return commands that take every drive through loops, steps and rest, and the readings.

    Commands are in order of the drives, exact in single precision too, shape (n, m), and readings
    in order of the probes, shape (n, p). They begin at rest at zero commands, and are stepped one
    sample at a time, as a target steps.
    """
    count = 200
    share = np.arange(1, count + 1) / count
    commands = np.empty((count, len(model.drives)))
    for j, drive in enumerate(model.drives):
        low, high = command_span(model, drive)
        loops = 0.5 - 0.5 * np.cos(2.0 * np.pi * (3.0 + 1.3 * j) * share)
        commands[:, j] = low + (high - low) * (0.05 + 0.8 * loops * (1.0 - 0.45 * share))
        # a step up in the first half, one down in the second, and rest at the end
        commands[int(count * (0.31 + 0.07 * j)) : count // 2, j] += 0.08 * (high - low)
        commands[int(0.88 * count) :, j] = low + (0.37 + 0.1 * (j % 3)) * (high - low)
    commands = commands.astype(np.float32).astype(np.float64)
    exported = model.as_exported()
    state = exported.settled()
    readings = np.empty((count, len(model.probes)))
    for i in range(count):
        u = {d.name: commands[i : i + 1, j] for j, d in enumerate(model.drives)}
        found = exported.simulate(u, state)
        state = found.state
        readings[i] = [found.readings[p.name][0] for p in model.probes]
    return commands, readings


def rounding_bound(model: DynamicModel) -> Array:
    r"""Return a bound of the error that rounding makes in the readings, for ever, by probe.

    What is rounded in a step, at most :math:`c\,u\,W` with the largest free displacement W and unit
    roundoff u of single precision, decays with the mode: errors of all steps add up to

    .. math:: \sum_d W_d \sum_i |r_{di}| \frac{c\,u}{1 - e^{-\zeta_i\omega_i h}}

    with the weights r of the reading and c = 42, which for slow modes is
    :math:`c u/(\zeta\omega h)`. Roundings go both ways, so that what is seen is some hundred times
    less. It is infinite where a mode is not damped.

    Notes
    -----
    Validity: commands within their range, modes that are not driven far above what they do at rest
    (times their amplification where they are), and loops of hysteresis of not too many steps: N
    steps all one way add up to ``N u/2`` of its memory, which 10,000 steps do not show beside the
    modes and a million do.
    """
    k = model.omega.size
    # an overdamped mode forgets by its slower root
    zeta = model.damping_ratio
    fall = (zeta - np.sqrt(np.maximum(zeta**2 - 1.0, 0.0))) * model.omega * model.step
    with np.errstate(divide="ignore"):
        growth = np.where(fall > 0.0, -1.0 / np.expm1(-fall), np.inf)
    bound = np.zeros(len(model.probes))
    for d in model.drives:
        low, high = command_span(model, d)
        if d.hysteresis is None:
            largest = abs(d.gain) * max(abs(low), abs(high))
        else:
            ends = d.hysteresis.simulate([low, high]).values
            largest = float(np.abs(ends).max())
        rate = np.abs(d.mode_weights[:, k:]) * model.omega
        reach = np.hypot(d.mode_weights[:, :k], rate)
        terms = 2.0 * k + d.lag_weights.shape[1]
        total = reach.sum(axis=1) + np.abs(d.lag_weights).sum(axis=1) + np.abs(d.feedthrough)
        bound += (
            largest
            * _SINGLE
            * (
                ROUNDINGS * (reach @ growth)
                + _LAG_ROUNDINGS * np.abs(d.lag_weights).sum(axis=1)
                + terms * total
            )
        )
    for j, p in enumerate(model.probes):
        if p.sensor is not None:
            bound[j] = abs(p.sensor.gain) * bound[j] + p.sensor.quantisation
            bound[j] += 4.0 * _SINGLE * abs(p.sensor.offset)
    return bound
