"""The C source of a dynamic model: common core, data of the model, and variables by name."""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from importlib.resources import files
from typing import Literal

from flexstage.base.errors import ModelError
from flexstage.base.version import __version__
from flexstage.export.source.model_numbers import form_of, model_data
from flexstage.hysteresis import Sensor
from flexstage.hysteresis.dynamic_model import DynamicModel, ModelDrive, ModelProbe
from flexstage.hysteresis.models.registry import hysteresis_code
from flexstage.hysteresis.models.source_code import HysteresisCode, source_file
from flexstage.system.environment import PositionLoop

# All headers, each after those that it includes.
_CORE = ("real.h", "piece.h", "amplifier.h", "sensor.h")
_BEHIND_DATA = ("modes.h", "lags.h")
_LAST = ("instance.h", "fitted.h", "prepare.h", "stage.h")


def render_source(model: DynamicModel) -> dict[str, bytes]:
    """Return a model as headers of C99: core, hysteresis and data.

    Include ``stage.h``, which documents the functions. They need no library but libm, allocate no
    memory and have no mutable global data; a byte copy of an instance is a saved state. With
    ``FS_SINGLE`` defined they are in single precision.

    Validity: in double precision, compiled without contraction of products and sums and without
    fast mathematics, readings equal those of `DynamicModel.simulate` stepped one sample at a
    time: bit for bit if hysteresis has a closed form between samples and both use the same libm,
    else to a relative 1e-12. After a change of parameters they equal those of a model with these
    parameters, to 1e-12.

    Examples
    --------
    >>> from flexstage.stage.designs import design
    >>> from flexstage.hysteresis import dynamic_model
    >>> from flexstage.lumped import lumped_system
    >>> stage = design("parallelogram")
    >>> headers = render_source(dynamic_model(stage, lumped_system(stage)))
    >>> list(headers)[-1], b"FS_MODES 8" in headers["model_data.h"]
    ('stage.h', True)
    """
    if not model.probes:
        raise ModelError(f"stage '{model.name}' has no probe: there is nothing to read from it")
    codes = {
        d.name: hysteresis_code(d.hysteresis) for d in model.drives if d.hysteresis is not None
    }
    out = {name: _core_file(name) for name in _CORE}
    origin = f"{model.title or model.name}. Written by flexstage {__version__}."
    out["model_data.h"] = model_data(model, codes, origin).encode()
    headers = dict.fromkeys(h for c in codes.values() for h in (*c.headers, c.header))
    for name in (*_BEHIND_DATA, *headers):
        out.setdefault(name, _core_file(name))
    out["model_hysteresis.h"] = _switch(model, codes).encode()
    for name in _LAST:
        out[name] = _core_file(name)
    return out


def _core_file(name: str) -> bytes:
    core = files("flexstage.export.source") / "c" / name
    return core.read_bytes() if core.is_file() else source_file(name)


def _switch(model: DynamicModel, codes: dict[str, HysteresisCode]) -> str:
    """Return the header that selects the hysteresis of each drive."""
    includes = sorted({c.header for c in codes.values()})
    lines = [
        "/* The hysteresis of each drive. */",
        "#ifndef FS_MODEL_HYSTERESIS_H",
        "#define FS_MODEL_HYSTERESIS_H",
        "",
        '#include "model_data.h"',
        '#include "piece.h"',
        '#include "real.h"',
        *(f'#include "{name}"' for name in includes),
        "",
        "/* Output of the hysteresis of a drive at u1; its memory moves there. */",
        "static inline fs_real fs_hysteresis_move(int drive, const fs_real *p, fs_real *memory, "
        "fs_real u1)",
        "{",
        "    switch (drive) {",
    ]
    for i, d in enumerate(model.drives):
        if d.name in codes:
            call = f"{codes[d.name].function}_move(p, memory, u1)"
            lines += [f"    case {i}:", f"        return {call};"]
    lines += [
        "    default:",
        "        (void)p;",
        "        memory[0] = u1;",
        "        return u1;",
        "    }",
        "}",
        "",
    ]
    pieces = [
        i for i, d in enumerate(model.drives) if form_of(codes.get(d.name)) == "FS_FORM_PIECES"
    ]
    if pieces:
        lines += [
            "/* Pieces of its output on the way there, and their number; -1 if not finite. */",
            "static inline int fs_hysteresis_line(int drive, const fs_real *p, fs_real *memory, "
            "fs_real u1,",
            "                                     fs_piece *pieces, fs_real *value)",
            "{",
            "    switch (drive) {",
        ]
        for i in pieces:
            call = f"{codes[model.drives[i].name].function}_line(p, memory, u1, pieces, "
            lines += [f"    case {i}:", f"        return {call}FS_PIECES_MAX, value);"]
        lines += ["    default:", "        return -1;", "    }", "}", ""]
    return "\n".join([*lines, "#endif"]) + "\n"


@dataclass(frozen=True, slots=True)
class CVariable:
    """A variable of a model in C."""

    name: str
    """Name, in parts separated by dots."""
    unit: str
    """Unit; ``1`` for none."""
    causality: Literal["input", "output", "parameter", "local"]
    """``input``, ``output``, ``parameter`` or ``local``."""
    start: float
    """Initial value: as exported, settled at zero commands."""
    description: str
    """Description."""
    expression: str
    """Expression in C: of an instance ``s``, or ``commands[i]`` and ``readings[i]`` of the
    arguments of the functions.
    """


def c_variables(model: DynamicModel) -> tuple[CVariable, ...]:
    """Return the commands, readings and parameters of the C source of a model.

    ===============================  =============================================================
    name                             description
    ===============================  =============================================================
    ``DRIVE.command``                command of a drive (input)
    ``PROBE.reading``                reading of a probe, through its sensor (output)
    ``DRIVE.voltage``                voltage behind the amplifier, of a drive with one (local)
    ``DRIVE.free_displacement``      free displacement; ``DRIVE.force`` of a pure force (local)
    ``PROBE.motion``                 motion before the sensor, of a probe with one (local)
    ``DRIVE.gain``                   free displacement over command, without hysteresis
    ``DRIVE.hysteresis.NAME``        a parameter of the hysteresis
    ``DRIVE.amplifier.NAME``         ``bandwidth_hz``, ``gain``, ``largest_rate``,
                                     ``lowest_voltage``, ``highest_voltage``
    ``DRIVE.creep.rate_per_decade``  rise of the creep in a decade of time over the step
    ``mode.N.frequency_hz``          undamped natural frequency, N from 1; static readings do not
                                     change
    ``mode.N.damping_ratio``         damping ratio
    ``sensor.PROBE.NAME``            ``gain``, ``offset``, ``bandwidth_hz`` (0: no lag),
                                     ``quantisation``, ``mains_amplitude``,
                                     ``mains_frequency_hz``, ``mains_phase``
    ===============================  =============================================================

    There are no variables for infinite limits, nor for parameters of tables that C does not compute
    (such as the exponent of a Bouc-Wen model).

    Examples
    --------
    >>> from flexstage.stage.designs import design
    >>> from flexstage.hysteresis import dynamic_model
    >>> from flexstage.lumped import lumped_system
    >>> stage = design("vgtu-piezo")
    >>> variables = c_variables(dynamic_model(stage, lumped_system(stage)))
    >>> [v.name for v in variables[:4]]
    ['x.command', 'y.command', 'x.reading', 'y.reading']
    """
    drives, probes = list(enumerate(model.drives)), list(enumerate(model.probes))
    variables = [_command(i, d) for i, d in drives]
    readings = _settled_readings(model)
    variables += [_reading(i, p, readings[p.name]) for i, p in probes]
    for i, d in drives:
        variables += _locals(i, d)
    for i, p in probes:
        if p.sensor is not None:
            what = f"motion at the sensor of probe {p.name}"
            variables.append(
                CVariable(f"{p.name}.motion", p.unit, "local", 0.0, what, f"s->motion[{i}]")
            )
    for i, d in drives:
        variables += _drive_parameters(i, d)
    variables += _mode_parameters(model)
    for i, p in probes:
        if p.sensor is not None:
            variables += _sensor_parameters(i, p, p.sensor)
    return tuple(variables)


def _settled_readings(model: DynamicModel) -> dict[str, float]:
    """Return the readings at rest at zero commands: offset, quantisation and mains of sensors."""
    readings = {}
    for p in model.probes:
        value = 0.0
        if p.sensor is not None:
            s = p.sensor
            value = s.offset
            if s.mains_amplitude != 0.0:
                turn = 2.0 * math.pi * s.mains_frequency_hz * -model.step + s.mains_phase
                value += s.mains_amplitude * math.sin(turn)
            if s.quantisation > 0.0:
                value = s.quantisation * round(value / s.quantisation)
        readings[p.name] = value
    return readings


def _command(i: int, d: ModelDrive) -> CVariable:
    limits = ""
    if d.input_range is not None:
        limits = f", {d.input_range[0]:g} to {d.input_range[1]:g} {d.unit}"
    what = f"command of drive {d.name} ({d.kind}){limits}"
    return CVariable(f"{d.name}.command", d.unit, "input", 0.0, what, f"commands[{i}]")


def _reading(i: int, p: ModelProbe, start: float) -> CVariable:
    through = "" if p.sensor is None else ", through its sensor"
    what = f"reading of probe {p.name}{through}"
    return CVariable(f"{p.name}.reading", p.unit, "output", start, what, f"readings[{i}]")


def _locals(i: int, d: ModelDrive) -> list[CVariable]:
    at, variables = f"s->drive[{i}]", []
    if d.amplifier is not None:
        what = f"voltage behind the amplifier of drive {d.name}"
        variables.append(CVariable(f"{d.name}.voltage", "V", "local", 0.0, what, f"{at}.voltage"))
    name, unit, what = "free_displacement", "m", "free displacement, without creep,"
    if d.stiffness == 0.0:
        name, unit, what = "force", "N", "force"
    what = f"{what} of drive {d.name}"
    variables.append(CVariable(f"{d.name}.{name}", unit, "local", 0.0, what, f"{at}.free"))
    return variables


# a parameter: name, unit, start, description, member of its struct
_Row = tuple[str, str, float, str, str]


def _parameters(owner: str, of: str, at: str, rows: Iterable[_Row]) -> list[CVariable]:
    return [
        CVariable(
            f"{owner}.{name}",
            unit,
            "parameter",
            start,
            f"{what} of {of}",
            f"{at}.{member}",
        )
        for name, unit, start, what, member in rows
    ]


def _drive_parameters(i: int, d: ModelDrive) -> list[CVariable]:
    rows: list[_Row] = []
    if d.hysteresis is None:
        unit = "m/V" if d.unit == "V" else "1"
        rows.append(("gain", unit, d.gain, "output over command", "gain"))
    else:
        for t in hysteresis_code(d.hysteresis).tunable:
            if t.index is not None:
                what, member = f"{t.description}, hysteresis", f"parameters[{t.index}]"
                rows.append((f"hysteresis.{t.name}", t.unit, t.value, what, member))
        if d.creep is not None:
            rate, what = d.creep.rate_per_decade, "rise of the creep in a decade of time"
            rows.append(("creep.rate_per_decade", "1", rate, what, "creep_rate"))
    a = d.amplifier
    if a is not None:
        low, high = a.voltage_range or (-math.inf, math.inf)
        for name, unit, start, what, member in (
            ("bandwidth_hz", "Hz", a.bandwidth_hz, "bandwidth of the amplifier", "bandwidth_hz"),
            ("gain", "1", a.gain, "gain of the amplifier", "amplifier_gain"),
            ("largest_rate", "V/s", a.largest_rate, "largest rate of the voltage", "largest_rate"),
            ("lowest_voltage", "V", low, "lowest voltage", "lowest"),
            ("highest_voltage", "V", high, "highest voltage", "highest"),
        ):
            if math.isfinite(start):
                rows.append((f"amplifier.{name}", unit, start, what, member))
    return _parameters(d.name, f"drive {d.name}", f"s->drive[{i}]", rows)


_NATURAL = "undamped natural frequency"


def _mode_parameters(model: DynamicModel) -> list[CVariable]:
    parameters = []
    modes = zip(model.omega.tolist(), model.damping_ratio.tolist(), strict=True)
    for i, (omega, zeta) in enumerate(modes):
        frequency, at = omega / (2.0 * math.pi), f"[{i}]"
        rows: list[_Row] = [
            ("frequency_hz", "Hz", frequency, _NATURAL, f"frequency_hz{at}"),
            ("damping_ratio", "1", zeta, "damping ratio", f"damping_ratio{at}"),
        ]
        of = f"mode {i + 1}, drives in place"
        parameters += _parameters(f"mode.{i + 1}", of, "s->modes", rows)
    return parameters


def _sensor_parameters(i: int, p: ModelProbe, sensor: Sensor) -> list[CVariable]:
    numbers = (
        ("gain", "1", sensor.gain, "gain"),
        ("offset", p.unit, sensor.offset, "offset"),
        ("bandwidth_hz", "Hz", sensor.bandwidth_hz or 0.0, "bandwidth (0: no lag)"),
        ("quantisation", p.unit, sensor.quantisation, "smallest step of the reading (0: none)"),
        ("mains_amplitude", p.unit, sensor.mains_amplitude, "amplitude of the mains pick-up"),
        ("mains_frequency_hz", "Hz", sensor.mains_frequency_hz, "frequency of the mains"),
        ("mains_phase", "rad", sensor.mains_phase, "phase of the mains at the first sample"),
    )
    rows = [(n, unit, start, what, n) for n, unit, start, what in numbers]
    of = f"the sensor of probe {p.name}"
    return _parameters(f"sensor.{p.name}", of, f"s->sensor[{i}]", rows)


#: A position control; its integral rests while the voltage is at a limit.
_SERVO = """\
/* Position control at {rate!r} Hz, written by flexstage. Start with a state of zeros. */
typedef struct {{
    double filter[{count}][2];
    double integral;
}} control_state;

/* Return the voltage between low and high for an error, reference less reading. */
double control(control_state *state, double error, double low, double high)
{{
    /* b0, b1, b2, a1, a2 */
    static const double section[{count}][5] = {{
        {rows}
    }};
    double integral, voltage;
    int k;

    for (k = 0; k < {count}; k++) {{
        const double *c = section[k];
        double *x = state->filter[k];
        const double y = c[0] * error + x[0];
        x[0] = c[1] * error - c[3] * y + x[1];
        x[1] = c[2] * error - c[4] * y;
        error = y;
    }}
    integral = state->integral + {step!r} * error;
    voltage = {proportional!r} * error + integral;
    if (voltage > high)
        return high;
    if (voltage < low)
        return low;
    state->integral = integral;
    return voltage;
}}
"""


def servo_source(loop: PositionLoop) -> str:
    """Return a position control as a function in C99, to be called at each sample.

    Raises
    ------
    ModelError
        The control has an inner loop.
    """
    if loop.damping is not None:
        raise ModelError(
            f"the control '{loop.name}' has an inner loop, which the code in C lacks: write it as "
            ".yaml"
        )
    settings, rate = loop.settings, loop.sample_rate
    sections = settings.sections(rate).tolist() or [[1.0, 0.0, 0.0, 0.0, 0.0]]
    return _SERVO.format(
        rate=rate,
        count=len(sections),
        rows=",\n        ".join(f"{{{', '.join(map(repr, row))}}}" for row in sections),
        proportional=settings.proportional,
        step=settings.integral / rate,
    )
