"""A dynamic model as C: the core that all models share, and the numbers of this one."""

from importlib.resources import files

from flexstage.base.errors import ModelError
from flexstage.base.version import __version__
from flexstage.export.source.model_numbers import form_of, model_data
from flexstage.hysteresis.dynamic_model import DynamicModel
from flexstage.hysteresis.models.registry import hysteresis_code
from flexstage.hysteresis.models.source_code import HysteresisCode, source_file

# Every header, each after those that it includes.
_CORE = ("real.h", "piece.h", "amplifier.h", "sensor.h")
_BEHIND_DATA = ("modes.h", "lags.h")
_LAST = ("instance.h", "fitted.h", "prepare.h", "stage.h")


def render_source(model: DynamicModel) -> dict[str, bytes]:
    """Return a model as headers of C99: the core, the hysteresis that is used, and the numbers.

    ``stage.h`` is the one to include; it says how the functions are called. They need no library
    but libm, allocate nothing and hold nothing global that changes; a copy of an instance's bytes
    is a saved state. With ``FS_SINGLE`` defined they are in single precision.

    Validity: in double precision, compiled without contraction of products and sums (and without
    fast mathematics), readings equal those of `DynamicModel.simulate` stepped one sample at a
    time: bit for bit where hysteresis is in closed form between samples and both use the same
    libm, to a relative 1e-12 where it is not. Parameters that were changed give what a model built
    with them gives, to 1e-12.

    Examples
    --------
    >>> from flexstage.stage.designs import design
    >>> from flexstage.hysteresis import dynamic_model
    >>> from flexstage.lumped import lumped_system
    >>> stage = design("parallelogram")
    >>> made = render_source(dynamic_model(stage, lumped_system(stage)))
    >>> list(made)[-1], b"FS_MODES 8" in made["model_data.h"]
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
    """Which hysteresis belongs to which drive."""
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
        "/* The output of a drive's hysteresis at u1; its memory moves there. */",
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
            "/* Its pieces on the way there, and their number; -1 where it is not finite. */",
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
