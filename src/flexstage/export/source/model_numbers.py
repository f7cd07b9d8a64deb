"""Numbers as C with the digits that restore the same bits, and the data header of a model."""

import math
import textwrap
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from flexstage.hysteresis import Sensor
from flexstage.hysteresis.chain.element import ORDERS
from flexstage.hysteresis.chain.lag import decay_share, lag_moments, ramp_share
from flexstage.hysteresis.chain.modal import unit_step
from flexstage.hysteresis.dynamic_model import DynamicModel, ModelDrive
from flexstage.hysteresis.model import Array
from flexstage.hysteresis.models.source_code import HysteresisCode

_WIDTH = 98


def c_number(value: float) -> str:
    """Return a number as C, with the digits that restore the same bits.

    Examples
    --------
    >>> c_number(0.1), c_number(-3.0), c_number(float("inf"))
    ('0.1', '-3.0', 'INFINITY')
    """
    number = float(value)
    if math.isnan(number):
        raise ValueError("a model of NaN cannot be written as C")
    if math.isinf(number):
        return "INFINITY" if number > 0.0 else "-INFINITY"
    return repr(number)


def c_comment(text: str) -> str:
    """Return a text that is safe in a comment of C.

    Examples
    --------
    >>> c_comment("10 µm */ x")
    '10 um * / x'
    """
    plain = text.replace("µ", "u").replace("μ", "u").replace("*/", "* /").replace("/*", "/ *")
    plain = plain.replace("\\", "/").replace("\n", " ")
    return plain.encode("ascii", "replace").decode()


def c_array(
    name: str, dimensions: Sequence[str], values: ArrayLike, comment: str, kind: str = "fs_real"
) -> str:
    """Return the definition of a constant array of numbers, with its sizes in C."""
    sizes = "".join(f"[{d}]" for d in dimensions)
    body = _braces(np.asarray(values, dtype=np.float64), "    ")
    return f"{_wrapped(comment)}\nstatic const {kind} {name}{sizes} = {body};\n"


def c_flags(name: str, dimension: str, values: Sequence[int | str], comment: str) -> str:
    """Return the definition of a constant array of `int`: numbers, or their names."""
    listed = ", ".join(str(v) for v in values)
    return f"{_wrapped(comment)}\nstatic const int {name}[{dimension}] = {{{listed}}};\n"


def _wrapped(comment: str) -> str:
    lines = textwrap.wrap(c_comment(comment), _WIDTH - 6)
    return "/* " + "\n * ".join(lines) + " */"


def _braces(values: np.ndarray, indent: str) -> str:
    if values.ndim > 1:
        inner = f",\n{indent}".join(_braces(v, indent + "    ") for v in values)
        return "{\n" + indent + inner + "}"
    lines, line = [], ""
    for text in (c_number(v) for v in values.tolist()):
        if line and len(indent) + len(line) + len(text) + 2 > _WIDTH:
            lines.append(line)
            line = ""
        line += (" " if line else "") + text + ","
    lines.append(line.rstrip(","))
    return "{" + f"\n{indent} ".join(lines) + "}"


def form_of(code: HysteresisCode | None) -> str:
    """Return the form of the free displacement of a drive between samples, as named in C."""
    if code is None:
        return "FS_FORM_LINE"
    return "FS_FORM_PIECES" if code.pieces else "FS_FORM_FITTED"


def lag_rates(drive: ModelDrive) -> Array:
    """Return one over the time constants of the creep of a drive [1/s]; none without hysteresis."""
    if drive.creep is None or drive.hysteresis is None:
        return np.zeros(0)
    return 1.0 / drive.creep.time_constants


def model_data(model: DynamicModel, codes: dict[str, HysteresisCode], origin: str) -> str:
    """Return ``model_data.h``, with sizes and numbers of a model.

    `codes` are those of the drives with hysteresis; the origin is in the first comment.
    """
    parts = [
        f"/* {c_comment(model.name)}: sizes and numbers of the model.\n *\n"
        f" * {c_comment(origin)}\n */",
        '#ifndef FS_MODEL_DATA_H\n#define FS_MODEL_DATA_H\n\n#include "real.h"\n',
        _sizes(model, codes),
        _drives(model, codes),
        _modes(model),
        _creep(model),
        _sensors(model),
        "#endif",
    ]
    return "\n".join(parts) + "\n"


def _filled(rows: Sequence[Array], smallest: int = 1) -> list[Array]:
    """Return rows padded with zeros along the last axis to the same length."""
    size = max(smallest, *(r.shape[-1] for r in rows))
    return [np.pad(r, [(0, 0)] * (r.ndim - 1) + [(0, size - r.shape[-1])]) for r in rows]


def _sizes(model: DynamicModel, codes: dict[str, HysteresisCode]) -> str:
    forms = [form_of(codes.get(d.name)) for d in model.drives]
    lags = max(lag_rates(d).size for d in model.drives)
    used = codes.values()
    sizes = {
        "FS_MODES": model.omega.size,
        "FS_DRIVES": len(model.drives),
        "FS_PROBES": len(model.probes),
        "FS_LAGS_MAX": max(lags, 1),
        "FS_PARAMETERS_MAX": max([1, *(c.parameters.size for c in used)]),
        "FS_MEMORY_MAX": _memory(codes),
        "FS_PIECES_MAX": max([1, *(c.pieces for c in used)]),
        "FS_HAS_PIECES": int("FS_FORM_PIECES" in forms),
        "FS_HAS_FITTED": int("FS_FORM_FITTED" in forms),
        "FS_HAS_CREEP": int(lags > 0),
    }
    lines = [f"#define FS_STEP FS_R({c_number(model.step)}) /* [s] */"]
    lines += [f"#define {name} {value}" for name, value in sizes.items()]
    lines += [
        "",
        "/* Form of the free displacement between samples: line, pieces, or fitted pieces. */",
        "enum { FS_FORM_LINE, FS_FORM_PIECES, FS_FORM_FITTED };",
        "",
    ]
    return "\n".join(lines)


def _memory(codes: dict[str, HysteresisCode]) -> int:
    return max([1, *(c.memory for c in codes.values())])


def _drives(model: DynamicModel, codes: dict[str, HysteresisCode]) -> str:
    drives, h, k = model.drives, model.step, model.omega.size
    drive_names = ", ".join(f"{i}: {d.name} [{d.unit}]" for i, d in enumerate(drives))
    drive_codes = [codes.get(d.name) for d in drives]
    readers = [d.mode_weights * np.concatenate((np.ones(k), np.full(k, 1.0 / h))) for d in drives]
    rest = [np.zeros(1) if d.hysteresis is None else d.hysteresis.initial_state() for d in drives]
    none = np.zeros(1)
    by = ("FS_DRIVES", "FS_PROBES", "FS_MODES")
    return "\n".join(
        [
            f"/* Drives: {c_comment(drive_names)} */",
            c_flags(
                "fs_data_form", by[0], [form_of(c) for c in drive_codes], "form between samples"
            ),
            c_flags(
                "fs_data_has_amplifier",
                by[0],
                [int(d.amplifier is not None) for d in drives],
                "1 with an amplifier",
            ),
            c_flags(
                "fs_data_imposed",
                by[0],
                [int(bool(np.any(d.rate_time != 0.0))) for d in drives],
                "1 for a rigid drive, whose rate acts too",
            ),
            c_flags(
                "fs_data_lags", by[0], [lag_rates(d).size for d in drives], "lags of the creep"
            ),
            c_flags(
                "fs_data_parameters_used",
                by[0],
                [0 if c is None else c.parameters.size for c in drive_codes],
                "parameters of the hysteresis",
            ),
            c_array(
                "fs_data_drive",
                (by[0], "9"),
                [_drive_numbers(d, h) for d in drives],
                "gain [m/V, 1]; amplifier: bandwidth [Hz], gain, largest rate [V/s], lowest and "
                "highest output [V]; creep: rise per decade [1]; amplifier: step over time "
                "constant, largest rate times time constant [V]",
            ),
            c_array(
                "fs_data_parameters",
                (by[0], "FS_PARAMETERS_MAX"),
                _filled([none if c is None else c.parameters for c in drive_codes]),
                "parameters of the hysteresis",
            ),
            c_array(
                "fs_data_rest",
                (by[0], "FS_MEMORY_MAX"),
                _filled(rest, _memory(codes)),
                "memory of the hysteresis without history",
            ),
            c_array(
                "fs_data_feedthrough",
                by[:2],
                [d.feedthrough for d in drives],
                "feedthrough of the free displacement to a probe [1]",
            ),
            c_array(
                "fs_data_by_rate",
                (by[0], by[2]),
                [d.rate_time / h for d in drives],
                "time factor of the rate of an imposed displacement, over the step [1]",
            ),
            c_array(
                "fs_data_reader_z",
                by,
                [r[:, :k] for r in readers],
                "weight of the deflection of a mode at a probe [1]",
            ),
            c_array(
                "fs_data_reader_v",
                by,
                [r[:, k:] for r in readers],
                "weight of the rate of a mode per sample at a probe [1]",
            ),
        ]
    )


def _drive_numbers(drive: ModelDrive, h: float) -> list[float]:
    amplifier, creep = drive.amplifier, drive.creep
    rate = 0.0 if creep is None or drive.hysteresis is None else creep.rate_per_decade
    if amplifier is None:
        return [drive.gain, 1.0, 1.0, 1.0, 0.0, 1.0, rate, 1.0, 1.0]
    low, high = amplifier.voltage_range or (-np.inf, np.inf)
    time_constant = amplifier.time_constant
    return [
        drive.gain,
        amplifier.bandwidth_hz,
        amplifier.gain,
        amplifier.largest_rate,
        low,
        high,
        rate,
        h / time_constant,
        amplifier.largest_rate * time_constant,
    ]


def _modes(model: DynamicModel) -> str:
    step = unit_step(model.omega * model.step, model.damping_ratio)
    k = ("FS_MODES",)
    return "\n".join(
        [
            c_array(
                "fs_data_frequency_hz",
                k,
                model.omega / (2.0 * np.pi),
                "undamped natural frequencies, drives in place [Hz]",
            ),
            c_array("fs_data_damping_ratio", k, model.damping_ratio, "damping ratios [1]"),
            c_array("fs_data_angle", k, step.angle, "phase advance of a mode in a step [rad]"),
            c_array(
                "fs_data_transition",
                ("4", *k),
                step.transition,
                "deflection and rate after a step by those before: zz, zv, vz, vv",
            ),
            c_array(
                "fs_data_moments",
                (str(ORDERS + 1), *k),
                step.moments,
                "effect of the derivatives of the force over a step: row j on the rate",
            ),
        ]
    )


def _creep(model: DynamicModel) -> str:
    drives, k = model.drives, model.omega.size
    rates = [lag_rates(d) for d in drives]
    ratios = [model.step / d.creep.time_constants if r.size and d.creep is not None else r
              for d, r in zip(drives, rates, strict=True)]  # fmt: skip
    sizes = ("FS_DRIVES", "FS_LAGS_MAX")
    blocks = [
        c_array(
            "fs_data_lag_ratio",
            sizes,
            _filled(ratios),
            "step over the time constant of a lag",
        ),
        c_array(
            "fs_data_lag_decay",
            sizes,
            _filled([np.exp(-r) for r in ratios]),
            "decay of a lag over a step",
        ),
        c_array(
            "fs_data_lag_moments",
            (sizes[0], str(ORDERS), sizes[1]),
            _filled([lag_moments(r) for r in ratios]),
            "effect of the derivatives of the input on a lag over a step",
        ),
        c_array(
            "fs_data_reader_lag",
            (sizes[0], "FS_PROBES", sizes[1]),
            _filled([d.lag_weights[:, : r.size] for d, r in zip(drives, rates, strict=True)]),
            "weight of a lag at a probe [1]",
        ),
    ]
    if any(r.size for r in rates):
        reach = [model.probe_shapes * d.modal_gain for d in drives]
        shares = [np.zeros(0) if d.creep is None or not r.size else d.creep.lag_shares
                  for d, r in zip(drives, rates, strict=True)]  # fmt: skip
        blocks += [
            c_array(
                "fs_data_lag_rate",
                sizes,
                _filled(rates),
                "one over the time constant of a lag [1/s]",
            ),
            c_array(
                "fs_data_lag_share",
                sizes,
                _filled(shares),
                "static gain of a lag over the rise of the creep in a decade",
            ),
            c_array(
                "fs_data_reach",
                (sizes[0], "FS_PROBES", "FS_MODES"),
                [r[:, :k] for r in reach],
                "weight of the deflection of a mode at a probe without creep [1]",
            ),
        ]
    return "\n".join(blocks)


def _sensors(model: DynamicModel) -> str:
    probe_names = ", ".join(f"{i}: {p.name} [{p.unit}]" for i, p in enumerate(model.probes))
    return "\n".join(
        [
            f"/* Probes: {c_comment(probe_names)} */",
            c_flags(
                "fs_data_has_sensor",
                "FS_PROBES",
                [int(p.sensor is not None) for p in model.probes],
                "1 with a sensor",
            ),
            c_array(
                "fs_data_sensor",
                ("FS_PROBES", "9"),
                [_sensor_numbers(p.sensor, model.step) for p in model.probes],
                "gain, offset, bandwidth [Hz] (0: no lag), quantisation, mains: amplitude, "
                "frequency [Hz], phase [rad]; shares of a constant and of a ramp that the lag "
                "follows in a step",
            ),
        ]
    )


def _sensor_numbers(sensor: Sensor | None, h: float) -> list[float]:
    if sensor is None:
        return [1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 1.0]
    ratio = np.inf
    if sensor.bandwidth_hz is not None:
        ratio = h / (1.0 / (2.0 * np.pi * sensor.bandwidth_hz))
    return [
        sensor.gain,
        sensor.offset,
        sensor.bandwidth_hz or 0.0,
        sensor.quantisation,
        sensor.mains_amplitude,
        sensor.mains_frequency_hz,
        sensor.mains_phase,
        float(decay_share(ratio)),
        float(ramp_share(ratio)),
    ]
