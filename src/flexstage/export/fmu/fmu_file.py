"""An FMU: one file that other simulation programs run as a block, with its header."""

import hashlib
import io
import uuid
import zipfile
from functools import partial
from importlib.resources import files
from typing import Literal
from xml.etree import ElementTree as ET

import numpy as np

from flexstage.errors import ModelError
from flexstage.export.fmu.compiled import OPTIONS, binary_folder, compiler, shared_library
from flexstage.export.fmu.description import MAIN, model_description
from flexstage.export.fmu.documentation import LICENSE, documentation
from flexstage.export.fmu.layout import INDICATORS, FmuLayout, fmu_layout
from flexstage.export.request import StageExport
from flexstage.export.source.arrays import c_array, c_comment, c_flags
from flexstage.export.source.render import render_source
from flexstage.hysteresis.dynamic_model import DynamicModel

_SHARED = ("fmu_export.h", "me.h", "fmu_body.h", "fmi_calls.h")
_OWN = {"2.0": ("fmi2_types.h", "fmi2.c"), "3.0": ("fmi3_types.h", "fmi3.c")}
_EPOCH = (1980, 1, 1, 0, 0, 0)  # the earliest time that a zip archive can hold


def fmu_files(
    model: DynamicModel,
    *,
    version: Literal["2.0", "3.0"] = "2.0",
    binary: bool | None = None,
) -> dict[str, bytes]:
    """Return a model as an FMU, for co-simulation and for model exchange.

    The FMU holds its sources, a library for computers like this one, and a page of documentation.
    Co-simulation steps as `DynamicModel.simulate` does, by whole multiples of `model.step`;
    with the parameter ``interpolation`` 1 commands move on straight lines as they do there, with 0,
    which is the default, they jump and hold, as importers expect. Model exchange hands the same
    stage to the importer's solver.

    Validity: that of the model. Under co-simulation readings are those of `DynamicModel.simulate`.
    Under model exchange they differ by the error of the solver and by what straight lines within
    a step leave out; without an amplifier a command that turns within an integrator step is seen
    to turn at its end.

    The archive is NAME.fmu, of FMI 2.0 or 3.0. `binary` says whether to compile a library; where
    not given, one is compiled where a C compiler is found.

    Examples
    --------
    >>> import io, zipfile
    >>> from flexstage.designs import design
    >>> from flexstage.hysteresis import dynamic_model
    >>> from flexstage.lumped import lumped_system
    >>> stage = design("parallelogram")
    >>> made = fmu_files(dynamic_model(stage, lumped_system(stage)), binary=False)
    >>> archive = zipfile.ZipFile(io.BytesIO(made["parallelogram.fmu"]))
    >>> archive.namelist()[-1], "modelDescription.xml" in archive.namelist()
    ('sources/stage.h', True)
    """
    if version not in MAIN:
        raise ModelError(f"there is no FMI version '{version}' here: take {' or '.join(MAIN)}")
    layout = fmu_layout(model)
    core = render_source(model)
    here = files("flexstage.export.fmu") / "c"
    wrapper = {name: (here / name).read_bytes() for name in (*_SHARED, *_OWN[version])}
    token = _token(model, layout, version, {**core, **wrapper})
    sources = {**core, **wrapper, "fmu_data.h": fmu_data(model, layout, token).encode()}
    made = {"modelDescription.xml": model_description(model, layout, version, token)}
    made |= {f"sources/{name}": content for name, content in sources.items()}
    if binary or (binary is None and compiler() is not None):
        folder, extension = binary_folder(version)
        library = shared_library(sources, MAIN[version], layout.identifier)
        made[f"binaries/{folder}/{layout.identifier}{extension}"] = library
    compiled = any(name.startswith("binaries/") for name in made)
    made["documentation/index.html"] = documentation(model, layout, version, compiled).encode()
    made["documentation/licenses/license.txt"] = LICENSE.encode()
    if version == "3.0":
        made["sources/buildDescription.xml"] = _build_description(layout)
    return {f"{layout.identifier}.fmu": _archive(made)}


def _token(model: DynamicModel, layout: FmuLayout, version: str, sources: dict[str, bytes]) -> str:
    """A token that belongs to this description and these sources, and to no others."""
    digest = hashlib.sha256()
    digest.update(model_description(model, layout, version, ""))
    digest.update(fmu_data(model, layout, "").encode())
    for name in sorted(sources):
        digest.update(name.encode())
        digest.update(sources[name])
    return f"{{{uuid.UUID(bytes=digest.digest()[:16], version=4)}}}"


def _build_description(layout: FmuLayout) -> bytes:
    root = ET.Element("fmiBuildDescription", fmiVersion="3.0")
    build = ET.SubElement(root, "BuildConfiguration", modelIdentifier=layout.identifier)
    # no compiler is named, so that the options are a hint; they hold for gcc and clang
    options = " ".join(OPTIONS[1:])
    sources = ET.SubElement(build, "SourceFileSet", language="C99", compilerOptions=options)
    ET.SubElement(sources, "SourceFile", name=MAIN["3.0"])
    return _xml(root)


def _xml(root: ET.Element) -> bytes:
    ET.indent(root, "  ")
    text = ET.tostring(root, encoding="unicode")
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{text}\n'.encode()


def _archive(content: dict[str, bytes]) -> bytes:
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
        for name in sorted(content):
            entry = zipfile.ZipInfo(name, date_time=_EPOCH)
            entry.compress_type = zipfile.ZIP_DEFLATED
            entry.create_system = 3
            entry.external_attr = (0o755 if name.startswith("binaries/") else 0o644) << 16
            archive.writestr(entry, content[name])
    return out.getvalue()


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
    reals = partial(c_array, kind="double")
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
            c_flags("fmu_voltage_at", drives, at.voltage_at, "voltage of each amplifier"),
            c_flags("fmu_lag_at", drives, at.lag_at, "first lag of each creep"),
            c_flags("fmu_seen_at", probes, at.seen_at, "lag of each sensor"),
            c_flags("fmu_amplified", drives, amplified or [0], "drives with an amplifier"),
            # a solver's numbers are double even where the core is single
            reals("fmu_usual_voltage", [drives], layout.usual_voltage, "[V]"),
            reals("fmu_nominal", ["FMU_STATES"], nominal, "usual size of each state"),
            "/* Modes are scaled to a modal mass of 1 kg. */",
            reals("fmu_gain", [drives, "FS_MODES"], gains, "of each mode for a unit of a drive"),
            reals("fmu_shape", [probes, "FS_MODES"], model.probe_shapes, "of each probe"),
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


def export(given: StageExport) -> dict[str, bytes]:
    """Write the format."""
    if not given.request.source_only and compiler() is None:
        given.remarks.append(
            "No C compiler was found: the FMU holds its sources alone, which few programs run. "
            "Install gcc or clang and export again."
        )
    files: dict[str, bytes] = {}
    for version in given.request.fmi_versions:
        made = fmu_files(
            given.dynamic,
            version=version,
            binary=False if given.request.source_only else None,
        )
        for name, content in made.items():
            # both versions may be asked for at once
            stem, dot, suffix = name.rpartition(".")
            files[f"{stem}-fmi{version[0]}{dot}{suffix}"] = content
    return files
