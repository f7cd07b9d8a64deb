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

#: Rounding errors of a step over the largest force: six terms of the size of the force in
#: deflection and in rate, each with the rounding of its factor, its product and three sums.
ROUNDINGS = 42.0
# rounding errors of a step of a lag, which are carried, over its input
_LAG_ROUNDINGS = ROUNDINGS
_SINGLE = 2.0**-24


def opening(model: DynamicModel, prefix: str, *, single: bool) -> str:
    """Return the first comment of a header."""
    big = prefix.upper()
    lines = [
        f"{prefix}.h: flexure stage {model.name}, real-time simulation.",
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
        "Usage:",
        f'  #include "{prefix}.h"',
        f"  static {prefix}_stage stage;",
        f"  {prefix}_real commands[{big}_DRIVES], readings[{big}_PROBES];",
        f"  {prefix}_init(&stage);                            once: at rest at zero commands",
        f"  {prefix}_settle(&stage, commands);                optional: at rest at other commands",
        f"  {prefix}_step(&stage, commands, readings);        every step; returns 0 or a message",
        f"  {prefix}_self_test(&stage);                       then call init or settle again",
        "",
        *_wrapped(
            "No memory allocation, no input or output, no recursion, no library but libm, no "
            "mutable global data: instances are independent. A byte copy of an instance is a saved "
            "state. C99 or C++11."
        ),
        "",
        *_wrapped(
            f"Cost of a step: about {operations(model)} additions and multiplications; the state "
            f"has {state_numbers(model)} numbers. An instance has sizeof({prefix}_stage) bytes "
            "with its tables, the constants about the same again. At rest at exactly zero the "
            "modes decay to denormal numbers; if these are slow on the processor, let it flush "
            "them to zero."
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
        words.append(f"creep {100.0 * d.creep.rate_per_decade:.3g} % per decade")
    if d.stiffness is None:
        words.append("imposed displacement")
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
            "Accuracy: double precision. Compiled with -ffp-contract=off, without fast "
            "mathematics, and with the libm of the same system, readings equal those of flexstage "
            "stepped one sample at a time: bit for bit if the hysteresis has a closed form, else "
            "to about 1e-12 of the stroke."
        )
    bound = rounding_bound(model)
    bounds = ", ".join(
        f"{p.name} {b:.2g} {p.unit}" for p, b in zip(model.probes, bound.tolist(), strict=True)
    )
    text = (
        "Accuracy: single precision. Accumulated rounding errors are below "
        f"{bounds}: {ROUNDINGS:g} u/(1 - exp(-zeta omega h)) of each mode's part, u = 6e-8; "
        "observed errors are about a hundred times smaller. Not for commands that excite a lightly "
        "damped mode for long, whose amplification adds to the error. Compile without fast "
        "mathematics."
    )
    if any(d.hysteresis is not None for d in model.drives):
        text += (
            " A hysteresis also rounds its memory in every step: N steps in one direction cause a "
            "relative error of up to N u/2; observed is a twentieth, 1e-3 of the stroke in a ramp "
            "of 2.5 million steps. Use double precision for ramps of minutes."
        )
    return _wrapped(text)


def operations(model: DynamicModel) -> int:
    """Return the approximate number of additions and multiplications of a step.

    Steps in which a hysteresis changes its branch need more.
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
        # nine derivatives of an exponential that decays by a few percent in a step
        total += k * 2 * 8 + lags * (2 * 9 + 6) + 100
    return int(round(total, -1))


def state_numbers(model: DynamicModel) -> int:
    """Return the number of state variables of the model.

    They are deflections and rates of the modes by drive, lags, hysteresis, amplifier, sensors.
    """
    total = 0
    for d in model.drives:
        memory = 1 if d.hysteresis is None else int(np.size(d.hysteresis.initial_state()))
        total += 2 * model.omega.size + lag_rates(d).size + memory + 3
    return total + sum(3 for p in model.probes if p.sensor is not None)


def command_span(model: DynamicModel, drive: ModelDrive) -> tuple[float, float]:
    """Return the usual range of the command of a drive [unit of the command].

    It is its range if known, else its stroke or largest force in both directions, else 10 um or
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
    """Return commands with loops, steps and rest of every drive, and the readings.

    Commands are in order of the drives, exact in single precision too, shape (n, m), and readings
    in order of the probes, shape (n, p). They begin at rest at zero commands, one sample per step,
    as on a target.
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
        response = exported.simulate(u, state)
        state = response.state
        readings[i] = [response.readings[p.name][0] for p in model.probes]
    return commands, readings


def rounding_bound(model: DynamicModel) -> Array:
    r"""Return a bound of the rounding error of the readings, for any time, by probe.

    The rounding error of a step, at most :math:`c\,u\,W` with the largest free displacement W and
    unit roundoff u of single precision, decays with the mode: errors of all steps add up to

    .. math:: \sum_d W_d \sum_i |r_{di}| \frac{c\,u}{1 - e^{-\zeta_i\omega_i h}}

    with the weights r of the reading and c = 42, which for slow modes is
    :math:`c u/(\zeta\omega h)`. Rounding errors have both signs, so that observed errors are about
    a hundred times smaller. The bound is infinite for a mode without damping.

    Notes
    -----
    Validity: commands within their range, and modes that are not excited far above their static
    deflection (otherwise times their amplification). Steps of a hysteresis in one direction are not
    too many: N steps add up to ``N u/2`` of its memory, negligible for 10,000 steps but not for a
    million.
    """
    k = model.omega.size
    # an overdamped mode decays with its slower root
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
# A weight below this share of the largest is negligible in single precision; its products would be
# denormal numbers, which are slow on many processors.
_NEGLIGIBLE = 1e-20
# Largest deviation of a self-test in double precision: another libm, another order of products.
_DOUBLE_LIMIT = 1e-9


def realtime_files(
    model: DynamicModel,
    *,
    precision: Literal["double", "single"] = "double",
    name: str | None = None,
) -> dict[str, bytes]:
    """Return a stage as one header of C for a real-time target.

    ``NAME.h`` steps the model with a fixed step, without memory allocation, input or output, or a
    library but libm; all names have the prefix NAME. ``NAME_example.c`` is a main loop;
    ``NAME_check.csv`` has the commands and readings of ``NAME_self_test``.

    NAME, the prefix of the names in C, is by default that of the stage (`c_prefix`).

    Notes
    -----
    Validity: in double precision the readings equal those of `DynamicModel.simulate` stepped one
    sample at a time, bit for bit if hysteresis has a closed form; in single precision within
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
        raise ModelError(f"the precision must be double or single, got '{precision}'")
    single = precision == "single"
    prefix = c_prefix(model.name) if name is None else name
    if not re.fullmatch(rf"[A-Za-z][A-Za-z0-9_]{{0,{_LONGEST - 1}}}", prefix):
        raise ModelError(
            f"'{prefix}' is not a valid prefix of names in C: it must begin with a letter and have "
            f"at most {_LONGEST} letters, digits and _"
        )
    commands, readings = check_samples(model)
    swing = [float(s) or 1.0 for s in np.ptp(readings, axis=0)]
    exported = _without_negligible_weights(model) if single else model
    guard = f"{prefix.upper()}_HEADER"
    body = amalgamated(render_source(exported)) + _self_test(commands, readings, swing)
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
    """Return a valid prefix of names in C, of at most 40 small letters, digits and _.

    Examples
    --------
    >>> c_prefix("VGTU -- piezo"), c_prefix("2-axis")
    ('vgtu_piezo', 'stage_2_axis')
    """
    name = re.sub(r"[^a-z0-9]+", "_", text.lower()).strip("_")
    if not name or not name[0].isalpha():
        name = f"stage_{name}".rstrip("_")
    return name[:_LONGEST].rstrip("_")


def _without_negligible_weights(model: DynamicModel) -> DynamicModel:
    """Return the model without weights that are negligible in single precision."""

    def cleared(d: ModelDrive) -> ModelDrive:
        weights = d.mode_weights.copy()
        k = weights.shape[1] // 2
        for part, scale in ((weights[:, :k], 1.0), (weights[:, k:], 1.0 / model.step)):
            largest = np.abs(weights[:, :k]).max(initial=0.0)
            part[np.abs(part) * scale < _NEGLIGIBLE * largest] = 0.0
        return replace(d, mode_weights=weights)

    return replace(model, drives=tuple(cleared(d) for d in model.drives))


def _self_test(commands: Array, readings: Array, swing: list[float]) -> str:
    """Return the self-test function with its samples."""
    count = str(len(commands))
    arrays = "\n".join(
        (
            c_array("commands", (count, "FS_DRIVES"), commands, "commands, one row per step"),
            c_array("expected", (count, "FS_PROBES"), readings, "readings by flexstage"),
            c_array("swing", ("FS_PROBES",), swing, "range of the readings"),
        )
    )
    indented = "".join(f"    {line}\n" if line else "" for line in arrays.splitlines())
    return f"""
/* Step through {count} samples computed by flexstage, from rest; return the largest deviation of a
 * reading over its range [1], infinite if a step fails. The stage keeps its final state. */
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
    texts = ([f"{value:.17g}" for value in row] for row in rows)
    return csv_text([_columns(model), *texts]).encode()


_LOCAL_INCLUDE = re.compile(r'^\s*#\s*include\s+"([^"]+)".*\n', re.MULTILINE)


_SYSTEM_INCLUDE = re.compile(r"^\s*#\s*include\s+<([^>]+)>.*\n", re.MULTILINE)


def amalgamated(sources: Mapping[str, bytes]) -> str:
    """Return headers, each after those that it includes, as one text with system headers first."""
    parts: list[str] = []
    system: dict[str, None] = {}
    included: set[str] = set()
    for name, content in sources.items():
        text = content.decode("utf-8")
        for needed in _LOCAL_INCLUDE.findall(text):
            if needed not in included:
                raise ValueError(f"{name} includes {needed}, which is not before it")
        system.update(dict.fromkeys(_SYSTEM_INCLUDE.findall(text)))
        included.add(name)
        parts.append(_SYSTEM_INCLUDE.sub("", _LOCAL_INCLUDE.sub("", text)).strip("\n"))
    head = "".join(f"#include <{name}>\n" for name in system)
    return head + "\n" + re.sub(r"\n{3,}", "\n\n", "\n\n".join(parts)) + "\n"


def prefixed(text: str, prefix: str) -> str:
    """Return C with another prefix for the names of the core, fs_... and FS_....

    Macros have it in capitals, so that headers with different prefixes fit into one program.

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

    Denormal numbers become zero.

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


def export(stage_export: StageExport) -> dict[str, bytes]:
    """Return the files of the format."""
    return realtime_files(stage_export.dynamic, precision=stage_export.request.precision)
