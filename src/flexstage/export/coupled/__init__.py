"""Files of coupled drives: a C header that steps them, and linear systems for MATLAB and Octave."""

import re
import textwrap
from collections.abc import Sequence
from importlib import resources

import numpy as np

from flexstage.base.arrays import Array, Complex
from flexstage.base.errors import ModelError
from flexstage.base.version import __version__
from flexstage.export.realtime import prefixed
from flexstage.export.simulink.matlab_text import mat_file
from flexstage.export.source.model_numbers import c_array, c_comment, c_number
from flexstage.files.plain import csv_text
from flexstage.hysteresis.coupled_drives.model import (
    LEVEL_MARGIN,
    CoupledDriveModel,
    step_constants,
)

#: Samples of the table to check the C with.
_CHECKED = 200


def coupled_files(
    model: CoupledDriveModel, name: str, formats: Sequence[str] = ("all",)
) -> dict[str, dict[str, bytes]]:
    """Return the files of coupled drives by format, ``c`` and ``mat``, and name.

    ``NAME.h`` steps the model as `CoupledDriveModel.simulate` does, in C99 with no library but
    libm; ``NAME_voltages`` is its `CoupledDriveModel.voltages`. ``NAME_check.csv`` has voltages and
    readings from rest. ``NAME.mat`` has the discrete linear systems of the weakest, the mean and
    the strongest level of the records.
    """
    writers = {"c": _c_files, "mat": _mat_files}
    names = tuple(writers) if tuple(formats) == ("all",) else tuple(formats)
    other = [name for name in names if name not in writers]
    if other:
        raise ModelError(f"coupled drives are exported to c and mat, got '{other[0]}'")
    return {kind: writers[kind](model, name) for kind in names}


def _mat_files(model: CoupledDriveModel, name: str) -> dict[str, bytes]:
    ends = np.mean(model.level_range, axis=0).tolist()
    systems = {}
    for key, level in (("weakest", ends[0]), ("middle", None), ("strongest", ends[1])):
        form = model.linear(level)
        systems[key] = {"A": form.A, "B": form.B, "C": form.C, "D": form.D}
    signals = {"inputs": list(model.inputs), "outputs": list(model.outputs), "levels": ends}
    return {f"{name}.mat": mat_file({**systems, "step": 1.0 / model.sample_rate_hz, **signals})}


def _c_files(model: CoupledDriveModel, name: str) -> dict[str, bytes]:
    prefix = re.sub(r"\W", "_", name, flags=re.ASCII).lower()
    prefix = prefix if prefix[:1].isalpha() else f"stage_{prefix}"
    code = (resources.files("flexstage.export.coupled") / "coupled_drives.h").read_text("ascii")
    guard = f"{prefix.upper()}_HEADER"
    text = (
        f"{_opening(model, prefix)}\n#ifndef {guard}\n#define {guard}\n\n#include <math.h>\n"
        f"#include <string.h>\n\n{prefixed(_data(model) + code, prefix)}\n#endif\n"
    )
    return {f"{prefix}.h": text.encode("ascii"), f"{prefix}_check.csv": _check(model)}


def _opening(model: CoupledDriveModel, prefix: str) -> str:
    bounds = (
        f"{name} {low:.3g} to {high:.3g} {model.input_unit}"
        for name, (low, high) in zip(model.inputs, model.level_range, strict=True)
    )
    lines = [
        f"{prefix}.h: {len(model.inputs)} coupled drives. Written by flexstage {__version__}.",
        f"Voltages {', '.join(model.inputs)} [{model.input_unit}]; readings "
        f"{', '.join(model.outputs)} [{model.output_unit}]: deviations from the operating point.",
        f"Step: {1.0 / model.sample_rate_hz:.9g} s ({model.sample_rate_hz:g} Hz), fixed.",
        f"static {prefix}_state state; {prefix}_init(&state) once; {prefix}_step(&state, voltages, "
        "readings) every step. No memory allocation, no mutable global data. C99.",
        f"Validity: levels of {', '.join(bounds)} rms, {model.band_hz[0]:.4g} to "
        f"{model.band_hz[1]:.4g} Hz.",
    ]
    wrapped = (part for line in lines for part in textwrap.wrap(c_comment(line), 94))
    return "/* " + "\n * ".join(wrapped) + "\n */"


def _data(model: CoupledDriveModel) -> str:
    """Return sizes and numbers as C."""
    c = step_constants(model)
    m, p = len(model.inputs), len(model.outputs)
    power, voltage_power, share = c.levels
    sizes = (
        ("INPUTS", m), ("OUTPUTS", p), ("MODES", len(c.modes[0])), ("LAGS", len(c.lags[0])),
        ("POLES", len(c.system[0])),
    )  # fmt: skip
    numbers = (
        ("FORCE_POWER", power), ("VOLTAGE_POWER", voltage_power), ("LEVEL_SHARE", share),
        ("MEMORY_AT_ONCE", c.lags[4]),
    )  # fmt: skip
    largest = (LEVEL_MARGIN * np.array(model.level_range)[:, 1]) ** 2
    arrays = (
        ("force_gains", "INPUTS INPUTS", c.drives[0], "Gains from voltages to w"),
        ("strength", "INPUTS", c.drives[1], "Strengths of the softening"),
        ("force_reference", "INPUTS", c.drives[2], "Mean power of the level of w"),
        ("voltage_reference", "INPUTS", c.drives[3], "Mean power of the level of the voltages"),
        ("largest_square", "INPUTS", largest, "Largest square of the level of the voltages"),
        ("mode_gains", "MODES 2", c.modes[0], "Elongation of the states of the modes"),
        ("mode_decay", "MODES 2", c.modes[1], "Factor of their states in a step"),
        ("mode_before", "MODES 2", c.modes[2], "Effect of the total at its beginning"),
        ("mode_after", "MODES 2", c.modes[3], "Effect of the total at its end"),
        ("mode_shapes", "MODES INPUTS", c.modes[4], "Input vectors of the modes"),
        ("direct", "INPUTS INPUTS", c.modes[5], "Elongation at once"),
        ("lag_gains", "LAGS", c.lags[0], "Gains of the lags of the voltages"),
        ("lag_decay", "LAGS", c.lags[1], "Factor of their states in a step"),
        ("lag_before", "LAGS", c.lags[2], "Effect of the input at its beginning"),
        ("lag_after", "LAGS", c.lags[3], "Effect of the input at its end"),
        ("poles", "POLES 2", c.system[0], "Poles of the linear system"),
        ("output_shapes", "OUTPUTS POLES 2", c.system[1], "Its output vectors"),
        ("input_shapes", "POLES INPUTS 2", c.system[2], "Its input vectors"),
        ("feedthrough", "OUTPUTS INPUTS", c.system[3], "Its feedthrough"),
    )
    text = [f"enum {{ {', '.join(f'FS_{key} = {size}' for key, size in sizes)} }};"]
    text += [f"#define FS_{key} {c_number(value)}" for key, value in numbers]
    for key, size, values, comment in arrays:
        dimensions = [s if s.isdigit() else f"FS_{s}" for s in size.split()]
        text.append(c_array(f"fs_{key}", dimensions, _real(values), comment, "double"))
    return "\n".join(text) + "\n"


def _real(values: Array | Complex) -> Array:
    """Return an array whose last dimension has the real and imaginary part of complex numbers."""
    parts = (np.real(values), np.imag(values))
    return np.stack(parts, axis=-1) if np.iscomplexobj(values) else parts[0]


def _check(model: CoupledDriveModel) -> bytes:
    """Return voltages within the levels of the records, and the readings from rest."""
    level = np.array(model.level_range)[:, 0]
    rng = np.random.default_rng(0)
    voltages = level * rng.uniform(-1.0, 1.0, (_CHECKED, len(level)))
    readings, _ = model.simulate(voltages)
    head = [f"{n} [{model.input_unit}]" for n in model.inputs]
    head += [f"{n} [{model.output_unit}]" for n in model.outputs]
    rows = np.column_stack((voltages, readings)).tolist()
    return csv_text([head, *([f"{value:.17g}" for value in row] for row in rows)]).encode()
