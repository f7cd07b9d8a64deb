"""An FMU: one file that other simulation programs run as a block, with its header and its icon."""

import hashlib
import io
import uuid
import zipfile
from importlib.resources import files
from typing import TYPE_CHECKING, Literal
from xml.etree import ElementTree as ET

import numpy as np

from flexstage.errors import ModelError
from flexstage.export.fmu.compiled import OPTIONS, binary_folder, compiler, shared_library
from flexstage.export.fmu.description import MAIN, model_description
from flexstage.export.fmu.documentation import LICENSE, documentation
from flexstage.export.fmu.layout import INDICATORS, FmuLayout, fmu_layout
from flexstage.export.request import ExportRequest
from flexstage.export.source.arrays import c_comment, c_number
from flexstage.export.source.render import render_source
from flexstage.hysteresis.dynamic_model import DynamicModel
from flexstage.hysteresis.model import Array
from flexstage.stage import Circle, Stage
from flexstage.stage.contour import body_contour

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_SHARED = ("fmu_export.h", "me.h", "fmu_body.h", "fmi_calls.h")
_OWN = {"2.0": ("fmi2_types.h", "fmi2.c"), "3.0": ("fmi3_types.h", "fmi3.c")}
_EPOCH = (1980, 1, 1, 0, 0, 0)  # the earliest time that a zip archive can hold
_PIXELS = 256
_HELD, _MOVED, _EDGE = "#9aa5b1", "#3f7fbf", "#1f2d3d"


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


def icon_png(stage: Stage | None) -> bytes:
    """Return a small square PNG: the plate, or a block between two leaf springs, on no ground."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(2.56, 2.56), dpi=_PIXELS / 2.56, facecolor="none")
    axes = figure.add_axes((0.02, 0.02, 0.96, 0.96))
    axes.set_aspect("equal")
    axes.set_axis_off()
    if stage is None:
        _sketch(axes)
    else:
        _plate(axes, stage)
    axes.autoscale_view()
    out = io.BytesIO()
    # nothing of the computer or the time in the file: the same stage gives the same bytes
    FigureCanvasAgg(figure).print_png(out, metadata={"Software": None})
    return out.getvalue()


def _plate(axes: "Axes", stage: Stage) -> None:
    from matplotlib.patches import PathPatch
    from matplotlib.path import Path

    for body in stage.bodies:
        outline, holes = body_contour(stage, body)
        loops = (outline, *holes, *body.mounting_holes)
        rings = [(x.loop() if isinstance(x, Circle) else x).polyline(1e-4) for x in loops]
        # a ring that turns the other way round is a hole
        rings = [rings[0], *(ring[::-1] if _turns_left(ring) else ring for ring in rings[1:])]
        if not _turns_left(rings[0]):
            rings[0] = rings[0][::-1]
        paths = [Path(np.vstack((ring, ring[:1])), closed=True) for ring in rings]
        colour = _HELD if body.fixed else _MOVED
        axes.add_patch(
            PathPatch(Path.make_compound_path(*paths), facecolor=colour, edgecolor=_EDGE, lw=0.4)
        )


def _turns_left(ring: Array) -> bool:
    x, y = ring.T
    return float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y)) > 0.0


def _sketch(axes: "Axes") -> None:
    from matplotlib.patches import Rectangle

    for x in (0.0, 8.6):
        axes.add_patch(Rectangle((x, 0.0), 1.4, 10.0, facecolor=_HELD, edgecolor=_EDGE, lw=1.0))
    for y in (2.2, 7.4):
        axes.add_patch(Rectangle((1.4, y), 7.2, 0.4, facecolor=_EDGE, edgecolor="none"))
    axes.add_patch(Rectangle((3.2, 1.4), 3.6, 7.2, facecolor=_MOVED, edgecolor=_EDGE, lw=1.0))


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


def export(request: ExportRequest) -> dict[str, bytes]:
    """Write the format."""
    if not request.source_only and compiler() is None:
        request.remarks.append(
            "No C compiler was found: the FMU holds its sources alone, which few programs run. "
            "Install gcc or clang and export again."
        )
    files: dict[str, bytes] = {}
    for version in request.fmi:
        made = fmu_files(
            request.dynamic,
            version=version,
            binary=False if request.source_only else None,
            stage=request.stage,
        )
        for name, content in made.items():
            # both versions may be asked for at once
            stem, dot, suffix = name.rpartition(".")
            files[f"{stem}-fmi{version[0]}{dot}{suffix}"] = content
    return files
