"""The files for a real-time target: one header of C, an example, and samples to check it with."""

import re
from collections.abc import Mapping
from dataclasses import replace
from importlib import resources
from typing import Literal

import numpy as np

from flexstage.base.arrays import Array
from flexstage.base.errors import ModelError
from flexstage.base.version import __version__
from flexstage.export.realtime.comment import (
    check_samples,
    command_span,
    opening,
    rounding_bound,
)
from flexstage.export.request import StageExport
from flexstage.export.source.model_numbers import c_array, c_comment, c_number
from flexstage.export.source.render import render_source
from flexstage.files.plain import csv_text
from flexstage.hysteresis.dynamic_model import DynamicModel, ModelDrive

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
