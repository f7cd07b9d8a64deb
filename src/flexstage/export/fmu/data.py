"""What the C code of an FMU must know about its variables: the header `fmu_data.h`."""

import numpy as np

from flexstage.export.fmu.layout import INDICATORS, FmuLayout
from flexstage.export.model import DynamicModel
from flexstage.export.source.arrays import c_comment, c_number


def fmu_data(model: DynamicModel, layout: FmuLayout, token: str) -> str:
    """Return ``fmu_data.h``, which ties value references to the core."""
    first, count, at = layout.first, layout.count, layout.states
    amplified = [i for i, place in enumerate(at.voltage_at) if place >= 0]
    numbers = {
        "FMU_TIME": 0,
        "FMU_INTERPOLATION": 1,
        "FMU_INTERPOLATION_START": 0,
        "FMU_FIRST_PARAMETER": first["parameter"],
        "FMU_PARAMETERS": count["parameter"],
        "FMU_FIRST_INPUT": first["input"],
        "FMU_FIRST_OUTPUT": first["output"],
        "FMU_FIRST_LOCAL": first["local"],
        "FMU_LOCALS": count["local"],
        "FMU_FIRST_STATE": first["state"],
        "FMU_STATES": count["state"],
        "FMU_FIRST_DERIVATIVE": first["derivative"],
        "FMU_FIRST_INDICATOR": first["indicator"],
        "FMU_INDICATORS": count["indicator"],
        "FMU_DEFLECTION_AT": at.deflection_at,
        "FMU_RATE_AT": at.deflection_at + model.omega.size,
    }
    assert count["indicator"] == len(INDICATORS) * len(amplified)
    parameters = [_case(v.reference, f"&{v.expression}") for v in layout.of("parameter")]
    locals_ = [_case(v.reference, v.expression) for v in layout.of("local")]
    nominal = np.array([v.nominal for v in layout.of("state")], dtype=np.float64)
    gains = np.array([d.modal_gain for d in model.drives])
    drives, probes = "FS_DRIVES", "FS_PROBES"
    return "\n".join(
        [
            f"/* Variables of the FMU of {c_comment(model.title or model.name)}: value references",
            " * as in modelDescription.xml, and where they are in the core. */",
            "#ifndef FMU_DATA_H",
            "#define FMU_DATA_H",
            "",
            '#include "stage.h"',
            "",
            f'#define FMU_TOKEN "{token}"',
            *(f"#define {name} {value}" for name, value in numbers.items()),
            "",
            "/* Where states of the solver are; -1: none. */",
            _ints("fmu_voltage_at", drives, at.voltage_at, "voltage of each amplifier"),
            _ints("fmu_lag_at", drives, at.lag_at, "first lag of each creep"),
            _ints("fmu_seen_at", probes, at.seen_at, "lag of each sensor"),
            _ints("fmu_amplified", drives, amplified or [0], "drives with an amplifier"),
            _reals("fmu_usual_voltage", f"[{drives}]", np.array(layout.usual_voltage), "[V]"),
            _reals("fmu_nominal", "[FMU_STATES]", nominal, "usual size of each state"),
            "/* Modes are scaled to a modal mass of 1 kg. */",
            _reals(
                "fmu_gain", f"[{drives}][FS_MODES]", gains, "of each mode for a unit of a drive"
            ),
            _reals("fmu_shape", f"[{probes}][FS_MODES]", model.probe_shapes, "of each probe"),
            "",
            "/* Where a parameter is; every reference that is asked for is one. */",
            "static fs_real *fmu_parameter(fs_stage *s, unsigned reference)",
            "{",
            "    switch (reference) {",
            *parameters,
            "    default: return &s->step; /* never reached */",
            "    }",
            "}",
            "",
            "static fs_real fmu_local(const fs_stage *s, unsigned reference)",
            "{",
            "    switch (reference) {",
            *locals_,
            "    default: return s->step; /* never reached */",
            "    }",
            "}",
            "",
            "#endif",
            "",
        ]
    )


def _case(reference: int, what: str) -> str:
    return f"    case {reference}: return {what};"


def _ints(name: str, size: str, values: tuple[int, ...] | list[int], comment: str) -> str:
    listed = ", ".join(str(v) for v in values)
    return f"/* {comment} */\nstatic const int {name}[{size}] = {{{listed}}};"


def _reals(name: str, sizes: str, values: np.ndarray, comment: str) -> str:
    # flat rows in inner braces; a solver's numbers are double even where the core is single
    rows = np.atleast_2d(values)
    lines = ["{" + ",\n     ".join(c_number(v) for v in row.tolist()) + "}" for row in rows]
    body = lines[0] if values.ndim == 1 else "{\n    " + ",\n    ".join(lines) + "}"
    return f"/* {comment} */\nstatic const double {name}{sizes} = {body};"
