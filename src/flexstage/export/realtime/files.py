"""The files for a real-time target: one header of C, an example, and samples to check it with."""

import re
import textwrap
from collections.abc import Mapping
from dataclasses import replace
from importlib import resources
from typing import Literal

import numpy as np

from flexstage.base.arrays import Array
from flexstage.base.errors import ModelError
from flexstage.base.version import __version__
from flexstage.export.request import StageExport
from flexstage.export.source.model_numbers import c_array, c_comment, c_number, lag_rates
from flexstage.export.source.render import render_source
from flexstage.files.plain import csv_text
from flexstage.hysteresis.dynamic_model import DynamicModel, ModelDrive, ModelProbe

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


_LONGEST = 40
# A weight that is this much smaller than the largest is far below what single precision resolves;
# its products would fall below the smallest normal number, which slows many processors down.
_NOTHING = 1e-20
# What a self test may show in double precision: another libm, another order of products.
_DOUBLE_LIMIT = 1e-9


def realtime_files(
    model: DynamicModel,
    *,
    precision: Literal["double", "single"] = "double",
    name: str | None = None,
) -> dict[str, bytes]:
    """Return a stage as one header of C for a real-time target.

    ``NAME.h`` steps the model with a fixed step: no allocation, no input or output, no library but
    libm, all names under the prefix NAME. ``NAME_example.c`` is a main loop; ``NAME_check.csv``
    holds the commands and readings that ``NAME_self_test`` steps through.

    NAME, the prefix of the names in C, comes from the stage where not given.

    Notes
    -----
    Validity: in double precision the readings are those of `DynamicModel.simulate` stepped one
    sample at a time, bit for bit where hysteresis has a closed form; in single precision within
    `rounding_bound`.

    Examples
    --------
    >>> from flexstage.stage.designs import design
    >>> from flexstage.hysteresis import dynamic_model
    >>> from flexstage.lumped import lumped_system
    >>> stage = design("vgtu-piezo")
    >>> list(realtime_files(dynamic_model(stage, lumped_system(stage))))
    ['vgtu_piezo.h', 'vgtu_piezo_example.c', 'vgtu_piezo_check.csv']
    """
    if precision not in ("double", "single"):
        raise ModelError(f"the precision is double or single, got '{precision}'")
    single = precision == "single"
    prefix = c_prefix(model.name) if name is None else name
    if not re.fullmatch(rf"[A-Za-z][A-Za-z0-9_]{{0,{_LONGEST - 1}}}", prefix):
        raise ModelError(
            f"'{prefix}' is no prefix of names in C: begin with a letter, then letters, digits and "
            f"_, {_LONGEST} in all"
        )
    commands, readings = check_samples(model)
    swing = [float(s) or 1.0 for s in np.ptp(readings, axis=0)]
    written = _without_nothing(model) if single else model
    guard = f"{prefix.upper()}_HEADER"
    body = amalgamated(render_source(written)) + _self_test(commands, readings, swing)
    body = prefixed(in_single(body) if single else body, prefix)
    header = (
        opening(model, prefix, single=single)
        + f"#ifndef {guard}\n#define {guard}\n\n"
        + (f"#define {prefix.upper()}_SINGLE\n" if single else "")
        + body
        + "\n#endif\n"
    )
    limit = float(np.max(rounding_bound(model) / swing)) if single else _DOUBLE_LIMIT
    return {
        f"{prefix}.h": header.encode("ascii"),
        f"{prefix}_example.c": _example(model, prefix, limit).encode("ascii"),
        f"{prefix}_check.csv": _table(model, commands, readings),
    }


def c_prefix(text: str) -> str:
    """Return the nearest prefix of names that C allows, in small letters, at most 40.

    Examples
    --------
    >>> c_prefix("VGTU -- piezo"), c_prefix("2-axis")
    ('vgtu_piezo', 'stage_2_axis')
    """
    made = re.sub(r"[^a-z0-9]+", "_", text.lower()).strip("_")
    if not made or not made[0].isalpha():
        made = f"stage_{made}".rstrip("_")
    return made[:_LONGEST].rstrip("_")


def _without_nothing(model: DynamicModel) -> DynamicModel:
    """The model without weights that single precision cannot tell from nothing."""

    def cleared(d: ModelDrive) -> ModelDrive:
        weights = d.mode_weights.copy()
        k = weights.shape[1] // 2
        for part, scale in ((weights[:, :k], 1.0), (weights[:, k:], 1.0 / model.step)):
            largest = np.abs(weights[:, :k]).max(initial=0.0)
            part[np.abs(part) * scale < _NOTHING * largest] = 0.0
        return replace(d, mode_weights=weights)

    return replace(model, drives=tuple(cleared(d) for d in model.drives))


def _self_test(commands: Array, readings: Array, swing: list[float]) -> str:
    """The function that steps through the samples, with the samples."""
    count = str(len(commands))
    arrays = "\n".join(
        (
            c_array("commands", (count, "FS_DRIVES"), commands, "commands, a row a step"),
            c_array("expected", (count, "FS_PROBES"), readings, "readings by flexstage"),
            c_array("swing", ("FS_PROBES",), swing, "largest less smallest reading"),
        )
    )
    indented = "".join(f"    {line}\n" if line else "" for line in arrays.splitlines())
    return f"""
/* Step through {count} samples that flexstage computed, from rest, and return the largest deviation
 * of a reading over the swing of that reading [1]; infinite where a step fails. The stage is left
 * where they end. */
static inline fs_real fs_self_test(fs_stage *s)
{{
{indented}    fs_real largest = FS_R(0.0), readings[FS_PROBES];
    int i, p;
    fs_init(s);
    for (i = 0; i < {count}; i++) {{
        if (fs_step(s, commands[i], readings))
            return (fs_real)INFINITY;
        for (p = 0; p < FS_PROBES; p++) {{
            const fs_real off = FS_ABS(readings[p] - expected[i][p]) / swing[p];
            if (!(off <= largest))
                largest = off;
        }}
    }}
    return largest;
}}
"""


def _example(model: DynamicModel, prefix: str, limit: float) -> str:
    text = (
        resources.files("flexstage.export.realtime")
        .joinpath("example.c")
        .read_text(encoding="ascii")
    )
    spans = [command_span(model, d) for d in model.drives]
    names = ", ".join(f"{d.name} [{d.unit}]" for d in model.drives)
    for token, value in (
        ("STAGE_NAME", c_comment(model.name)),
        ("COMMAND_NAMES", c_comment(names)),
        ("FLEXSTAGE_VERSION", __version__),
        ("LOWEST", ", ".join(c_number(low) for low, _ in spans)),
        ("HIGHEST", ", ".join(c_number(high) for _, high in spans)),
        ("SELF_TEST_LIMIT", f"{limit:.2g}"),
        ("CSV_HEAD", ",".join(_columns(model)).replace("%", "%%").replace('"', "")),
        ("fs_.h", f"{prefix}.h"),
    ):
        text = text.replace(token, value)
    return prefixed(text, prefix)


def _columns(model: DynamicModel) -> list[str]:
    return [
        "time [s]",
        *(f"command {c_comment(d.name)} [{d.unit}]" for d in model.drives),
        *(f"reading {c_comment(p.name)} [{c_comment(p.unit)}]" for p in model.probes),
    ]


def _table(model: DynamicModel, commands: Array, readings: Array) -> bytes:
    time = model.step * np.arange(1, len(commands) + 1)
    rows = np.column_stack((time, commands, readings)).tolist()
    written = ([f"{value:.17g}" for value in row] for row in rows)
    return csv_text([_columns(model), *written]).encode()


_OWN = re.compile(r'^\s*#\s*include\s+"([^"]+)".*\n', re.MULTILINE)


_SYSTEM = re.compile(r"^\s*#\s*include\s+<([^>]+)>.*\n", re.MULTILINE)


def amalgamated(sources: Mapping[str, bytes]) -> str:
    """Return headers, each after those that it includes, as one text, system headers first."""
    parts: list[str] = []
    system: dict[str, None] = {}
    done: set[str] = set()
    for name, content in sources.items():
        text = content.decode("utf-8")
        for needed in _OWN.findall(text):
            if needed not in done:
                raise ValueError(f"{name} includes {needed}, which does not stand before it")
        system.update(dict.fromkeys(_SYSTEM.findall(text)))
        done.add(name)
        parts.append(_SYSTEM.sub("", _OWN.sub("", text)).strip("\n"))
    head = "".join(f"#include <{name}>\n" for name in system)
    return head + "\n" + re.sub(r"\n{3,}", "\n\n", "\n\n".join(parts)) + "\n"


def prefixed(text: str, prefix: str) -> str:
    """Return C with the names of the core, fs_... and FS_..., under a prefix of its own.

    Macros take it in capitals, so that two with other prefixes stand in one program.

    Examples
    --------
    >>> prefixed("fs_real x = FS_R(1.0);", "xy")
    'xy_real x = XY_R(1.0);'
    """
    text = re.sub(r"\bfs_(?=\w)", f"{prefix}_", text)
    return re.sub(r"\bFS_(?=\w)", f"{prefix.upper()}_", text)


_NUMBERS = re.compile(r"static const fs_real \w+(?:\[\w+\])+ = \{.*?\};", re.DOTALL)


_NUMBER = re.compile(r"(?<![\w.])-?\d+\.?\d*(?:e[+-]?\d+)?(?![\w.])")


def in_single(text: str) -> str:
    """Return C with the numbers of its constant arrays in the fewest digits of single precision.

    What is below the smallest normal number is zero.

    Examples
    --------
    >>> in_single("static const fs_real a[2] = {0.12345678901234, 1e-50};")
    'static const fs_real a[2] = {0.12345679f, 0.0f};'
    """
    return _NUMBERS.sub(lambda block: _after_sizes(block[0]), text)


def _after_sizes(block: str) -> str:
    head, numbers = block.split("=", 1)
    return f"{head}={_NUMBER.sub(lambda n: _single(n[0]), numbers)}"


def _single(number: str) -> str:
    value = np.float32(float(number))
    if abs(value) < np.finfo(np.float32).tiny:
        return "0.0f"
    text = str(value)
    return f"{text}f" if "." in text or "e" in text else f"{text}.0f"


def export(given: StageExport) -> dict[str, bytes]:
    """Write the format."""
    return realtime_files(given.dynamic, precision=given.request.precision)
