"""An FMU: one file that other simulation programs run as a block."""

import hashlib
import io
import uuid
import zipfile
from importlib.resources import files
from typing import Literal
from xml.etree import ElementTree as ET

from flexstage.errors import ModelError
from flexstage.export.fmu.compiled import OPTIONS, binary_folder, compiler, shared_library
from flexstage.export.fmu.data import fmu_data
from flexstage.export.fmu.description import MAIN, model_description
from flexstage.export.fmu.documentation import LICENSE, documentation
from flexstage.export.fmu.icon import icon_png
from flexstage.export.fmu.layout import FmuLayout, fmu_layout
from flexstage.export.model import DynamicModel
from flexstage.export.source.render import render_source
from flexstage.stage import Stage

_SHARED = ("fmu_export.h", "me.h", "fmu_body.h")
_OWN = {"2.0": ("fmi2_types.h", "fmi2.c"), "3.0": ("fmi3_types.h", "fmi3.c")}
_EPOCH = (1980, 1, 1, 0, 0, 0)  # the earliest time that a zip archive can hold


def fmu_files(
    model: DynamicModel,
    *,
    version: Literal["2.0", "3.0"] = "2.0",
    binary: bool | None = None,
    stage: Stage | None = None,
) -> dict[str, bytes]:
    """Return a model as an FMU, for co-simulation and for model exchange.

    The FMU holds its sources, a library for computers like this one, a page of documentation and an
    icon. Co-simulation steps as `DynamicModel.simulate` does, by whole multiples of `model.step`;
    with the parameter ``interpolation`` 1 commands move on straight lines as they do there, with 0,
    which is the default, they jump and hold, as importers expect. Model exchange hands the same
    stage to the importer's solver.

    Validity: that of the model. Under co-simulation readings are those of `DynamicModel.simulate`.
    Under model exchange they differ by the error of the solver and by what straight lines within
    a step leave out; without an amplifier a command that turns within an integrator step is seen
    to turn at its end.

    The archive is NAME.fmu, of FMI 2.0 or 3.0. `binary` says whether to compile a library; where
    not given, one is compiled where a C compiler is found. The stage is for its outline on the
    icon.

    Examples
    --------
    >>> import io, zipfile
    >>> from flexstage.designs import design
    >>> from flexstage.export import dynamic_model
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
    icon = icon_png(stage)
    if version == "2.0":
        made["model.png"] = icon
    else:
        made["sources/buildDescription.xml"] = _build_description(layout)
        made["terminalsAndIcons/icon.png"] = icon
        made["terminalsAndIcons/terminalsAndIcons.xml"] = _icon_description()
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


def _icon_description() -> bytes:
    root = ET.Element("fmiTerminalsAndIcons", fmiVersion="3.0")
    picture = ET.SubElement(root, "GraphicalRepresentation")
    corners = {"x1": "-100", "y1": "-100", "x2": "100", "y2": "100"}
    ET.SubElement(picture, "CoordinateSystem", corners, suggestedScalingFactorTo_mm="0.1")
    ET.SubElement(picture, "Icon", corners)
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
