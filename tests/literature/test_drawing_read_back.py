r"""The DXF file, read by libraries that did not write it.

Evidence (Exported files): DXF, read by GDAL (areas and necks): $3\cdot10^{-6}$
"""

import functools
import io
import math
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely

from flexstage.export.drawing.contours import PlateContours, plate_contours
from flexstage.export.drawing.dxf import DXF_LAYERS, dxf_files
from flexstage.export.drawing.wire import offset_contours
from flexstage.stage import Loop, mass_properties
from flexstage.stage.curve import Curve
from tests.drawing_stages import NOTCHES, PLATES, guide, quick

KERF = 0.31e-3
STAGES = {**PLATES, **{n: guide(p) for n, p in NOTCHES.items()}}
ALL = pytest.mark.parametrize("name", [quick(n, n) for n in STAGES])


def drawn(name: str, **options: float) -> bytes:
    (content,) = dxf_files(STAGES[name], **options).values()
    return content


#: The file of a stage, drawn once in a process.
dxf = functools.cache(drawn)


@functools.cache
def plate_of(name: str) -> PlateContours:
    """The contours of a stage, found once in a process."""
    return plate_contours(STAGES[name])


@functools.cache
def document_of(name: str) -> Any:
    """The file with the path of the wire, read once in a process by the writing library."""
    from ezdxf.filemanagement import read

    return read(io.StringIO(dxf(name, kerf=KERF).decode()))


def tags(content: bytes) -> list[tuple[int, str]]:
    """The pairs of group code and value that the format consists of."""
    lines = content.decode().splitlines()
    return [(int(c), v) for c, v in zip(lines[::2], lines[1::2], strict=True)]


def polylines(content: bytes) -> list[tuple[str, Loop]]:
    """Layer and loop [m] of every closed polyline, by the group codes of the format."""
    found = []
    pairs = tags(content)
    starts = [i for i, (c, v) in enumerate(pairs) if (c, v) == (0, "LWPOLYLINE")]
    for start in starts:
        layer, flags, points, bulges = "", 0, [], []
        for code, value in pairs[start + 1 :]:
            if code == 0:
                break
            if code == 8:
                layer = value
            elif code == 70:
                flags = int(value)
            elif code == 10:
                points.append((float(value) * 1e-3, math.nan))
                bulges.append(0.0)
            elif code == 20:
                points[-1] = (points[-1][0], float(value) * 1e-3)
            elif code == 42:
                bulges[-1] = float(value)
        assert flags & 1, "an open polyline"
        found.append((layer, Loop(tuple(points), tuple(bulges))))
    return found


@ALL
def test_gdal_reads_the_part_with_its_area_length_and_openings(name: str, tmp_path: Path) -> None:
    pyogrio = pytest.importorskip("pyogrio")
    stage = STAGES[name]
    path = tmp_path / "part.dxf"
    path.write_bytes(dxf(name))
    # chords of 0.25 degrees: of a radius r they cut off r (1 - cos 0.125 deg) = 2.4e-6 r
    pyogrio.set_gdal_config_options({"OGR_ARC_STEPSIZE": "0.25", "OGR_ARC_MAX_GAP": "0"})
    try:
        _, _, shapes, columns = pyogrio.raw.read(path, columns=["Layer"])
    finally:
        pyogrio.set_gdal_config_options({"OGR_ARC_STEPSIZE": None, "OGR_ARC_MAX_GAP": None})
    rings: dict[str, list[Any]] = {}
    for shape, layer in zip(shapely.from_wkb(shapes), columns[0], strict=True):
        rings.setdefault(layer, []).append(shape)
    plate = plate_of(name)
    assert len(rings["OUTLINE"]) == 1
    assert len(rings.get("SLOTS", [])) == len(plate.slots)
    assert len(rings.get("HOLES", [])) == len(plate.holes)
    closed = [*rings["OUTLINE"], *rings.get("SLOTS", []), *rings.get("HOLES", [])]
    assert all(line.is_ring and line.is_simple for line in closed)
    outer, *inner = (shapely.Polygon(line) for line in closed)
    area = outer.area - sum(p.area for p in inner)
    mass = sum(m.mass for m in mass_properties(stage).values())
    expected = mass / (stage.material.density * stage.thickness) * 1e6
    # in millimetres; a full circle of chords loses (0.25 deg)^2 / 6 = 3.2e-6 of its area, be it the
    # plate or an opening
    enclosed = outer.area + sum(p.area for p in inner)
    assert area == pytest.approx(expected, abs=3.2e-6 * enclosed)
    length = sum(Curve(*s).length for c in plate.contours for s in c.loop.segments()) * 1e3
    assert sum(line.length for line in closed) == pytest.approx(length, rel=2e-6)


@ALL
def test_gdal_finds_every_neck_within_a_nanometre(name: str, tmp_path: Path) -> None:
    pyogrio = pytest.importorskip("pyogrio")
    stage = STAGES[name]
    path = tmp_path / "part.dxf"
    path.write_bytes(dxf(name))
    # The contours have a corner at both ends of every neck, so the neck is among the chords' ends.
    # From there a chord leaves at half of its angle, so it cuts nothing off the neck itself.
    pyogrio.set_gdal_config_options({"OGR_ARC_STEPSIZE": "0.05", "OGR_ARC_MAX_GAP": "0"})
    try:
        _, _, shapes, columns = pyogrio.raw.read(path, columns=["Layer"])
    finally:
        pyogrio.set_gdal_config_options({"OGR_ARC_STEPSIZE": None, "OGR_ARC_MAX_GAP": None})
    chords = np.concatenate(
        [
            np.stack([(xy := shapely.get_coordinates(g))[:-1], xy[1:]], axis=1)
            for g, layer in zip(shapely.from_wkb(shapes), columns[0], strict=True)
            if layer in ("OUTLINE", "SLOTS")
        ]
    )
    for hinge in stage.hinges:
        t, half = hinge.profile.neck_thickness * 1e3, 0.5 * hinge.profile.length * 1e3
        c, s = math.cos(hinge.direction), math.sin(hinge.direction)
        # the chords about the neck, in the hinge's axes
        own = (chords - np.multiply(hinge.at, 1e3)) @ np.array([[c, -s], [s, c]])
        near = (np.abs(own[..., 0]) < 0.4 * half) & (np.abs(own[..., 1]) < 0.9 * t)
        own = own[near.any(axis=1)]
        above = own[..., 1].mean(axis=1) > 0.0
        upper, lower = (shapely.multilinestrings(list(own[side])) for side in (above, ~above))
        assert shapely.distance(upper, lower) == pytest.approx(t, abs=1e-6), hinge.name


@ALL
def test_coordinates_and_bulges_come_back_to_the_last_digits(name: str) -> None:
    plate = plate_of(name)
    expected = [c.loop for c in plate.contours if c.circle is None]
    found = [loop for layer, loop in polylines(dxf(name)) if layer in ("OUTLINE", "SLOTS")]
    assert len(found) == len(expected)
    for a, b in zip(found, expected, strict=True):
        # millimetres to metres and back: one unit in the last place each
        assert np.allclose(a.points, b.points, rtol=4e-16, atol=1e-19)
        assert (a.bulges or ()) == b.bulges


@ALL
def test_the_wire_path_in_the_file_is_the_path(name: str) -> None:
    plate = plate_of(name)
    paths = [p for p in offset_contours(plate, 0.5 * KERF) if p.circle is None]
    found = [x for layer, x in polylines(dxf(name, kerf=KERF)) if layer == "WIRE_PATH"]
    length = sum(Curve(*s).length for p in paths for s in p.loop.segments())
    assert len(found) == len(paths)
    total = sum(Curve(*s).length for loop in found for s in loop.segments())
    assert total == pytest.approx(length, rel=1e-13)


@ALL
def test_the_audit_of_the_writing_library_finds_nothing(name: str) -> None:
    from ezdxf.lldxf.const import versions_supported_by_save

    document = document_of(name)
    audit = document.audit()
    assert (audit.errors, audit.fixes) == ([], [])
    assert document.dxfversion in versions_supported_by_save
    space = document.modelspace()
    used = {entity.dxf.layer for entity in space}
    assert used <= set(DXF_LAYERS)
    assert used >= {"OUTLINE", "HINGES", "WIRE_PATH", "START_HOLES", "LEAD_IN", "CUT_ORDER"}
    # every hole for threading has its number and its lead
    counts = {
        layer: sum(e.dxf.layer == layer for e in space)
        for layer in ("WIRE_PATH", "START_HOLES", "LEAD_IN", "CUT_ORDER")
    }
    assert len(set(counts.values())) == 1


@ALL
def test_width_and_height_are_dimensions_of_the_file(name: str) -> None:
    from ezdxf import bbox

    document = document_of(name)
    dimensions = list(document.modelspace().query("DIMENSION"))
    outline = plate_of(name).outline.loop.polyline(1e-7) * 1e3
    found = [d.get_measurement() for d in dimensions]
    assert found == pytest.approx(np.ptp(outline, axis=0).tolist(), abs=1e-3)
    # what is written at them, by the library that draws them; whole and beside all contours
    texts = [e.text for d in dimensions for e in d.virtual_entities() if e.dxftype() == "MTEXT"]
    assert texts == [f"{round(value, 3):g}" for value in found]
    cut = [e for e in document.modelspace() if e.dxf.layer in ("WIRE_PATH", "START_HOLES")]
    box = bbox.extents(cut)
    across, up = (d.dxf.defpoint for d in dimensions)
    assert across.y > box.extmax.y
    assert up.x < box.extmin.x


def test_the_header_says_millimetres() -> None:
    pairs = tags(dxf("parallelogram"))
    at = pairs.index((9, "$INSUNITS"))
    assert pairs[at + 1] == (70, "4")
    assert pairs[pairs.index((9, "$ACADVER")) + 1] == (1, "AC1024")


def test_the_file_opens_at_the_whole_of_the_part() -> None:
    """Extents of the header against those of every entity, as another program reads them."""
    from ezdxf import bbox

    document = document_of("parallelogram")
    box = bbox.extents(document.modelspace())
    for name, corner in (("$EXTMIN", box.extmin), ("$EXTMAX", box.extmax)):
        assert document.header[name][:2] == pytest.approx((corner.x, corner.y), abs=0.5)
    # a program that has no styles of dimensions writes them by the header
    wanted = {"$INSUNITS": 4, "$LUNITS": 2, "$LUPREC": 6, "$DIMDSEP": ord("."), "$DIMDEC": 3}
    assert {name: document.header[name] for name in wanted} == wanted
    (view,) = document.viewports.get("*Active")
    assert tuple(view.dxf.center)[:2] == pytest.approx((box.center.x, box.center.y), abs=0.5)
    assert box.size.y <= view.dxf.height <= 3.0 * max(box.size.x, box.size.y)


def test_the_title_block_names_stage_material_thickness_and_cut() -> None:
    text = [v for c, v in tags(dxf("leaf-one-sided", kerf=KERF)) if c == 1]
    for words in (
        "Stage: guide",
        "Title: Guide <with> any notch & corners",
        "Material: Al 7075-T6",
        "Thickness: 6.3 mm",
        "Kerf: 0.31 mm",
        "Internal corners have a fillet of 0.155 mm.",
    ):
        assert words in text


def test_the_same_stage_gives_the_same_bytes() -> None:
    assert drawn("leaf", kerf=KERF) == drawn("leaf", kerf=KERF)


@pytest.mark.slow
def test_the_same_stage_gives_the_same_bytes_in_another_process() -> None:
    code = (
        "import sys; from flexstage.stage.designs import design; "
        "from flexstage.export import dxf_files; "
        "f, = dxf_files(design('parallelogram'), kerf=0.31e-3).values(); "
        "sys.stdout.buffer.write(f)"
    )
    # other orders of sets of words, in which the library keeps what it writes
    for seed in ("1", "4", "12345"):
        env = {**os.environ, "PYTHONHASHSEED": seed}
        out = subprocess.run([sys.executable, "-c", code], env=env, capture_output=True, check=True)
        assert out.stdout == dxf("parallelogram", kerf=KERF)
