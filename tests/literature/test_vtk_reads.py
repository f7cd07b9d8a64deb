"""Files for ParaView as the Visualization Toolkit's own readers read them.

Evidence (Exported files): VTU, read by VTK (probe readings): $10^{-9}$
"""

import csv
import io
import re
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from flexstage.base.errors import ModelError
from flexstage.export.fields import field_files
from flexstage.fem import MeshSettings, StageModel, plane_model, solid_model
from flexstage.hinges import Leaf
from flexstage.lumped import lumped_system
from flexstage.quantities.material import material
from flexstage.stage import Body, Hinge, Loop, Stage, mass_properties
from flexstage.stage.designs import design
from flexstage.system import Analysis, analyse


def part(name: str) -> Any:
    """A part of the library, which loads a hundred where it is imported whole."""
    return pytest.importorskip(f"vtkmodules.{name}", exc_type=ImportError)


core, xml, filters = part("vtkCommonCore"), part("vtkIOXML"), part("vtkFiltersCore")
surfaces, verdict = part("vtkFiltersGeometry"), part("vtkFiltersVerdict")
support = part("util.numpy_support")

PIEZO = design("vgtu-piezo")
SMALL = design("parallelogram")
Files = dict[str, bytes]


@contextmanager
def quiet() -> Iterator[None]:
    """Let no message of the toolkit pass."""
    heard, before = core.vtkStringOutputWindow(), core.vtkOutputWindow.GetInstance()
    core.vtkOutputWindow.SetInstance(heard)
    try:
        yield
    finally:
        core.vtkOutputWindow.SetInstance(before)
    assert heard.GetOutput() == ""


def read(content: bytes, folder: Path) -> Any:
    """Read a grid by the toolkit's own reader."""
    path = folder / "grid.vtu"
    path.write_bytes(content)
    reader = xml.vtkXMLUnstructuredGridReader()
    with quiet():
        assert reader.CanReadFile(str(path))
        reader.SetFileName(str(path))
        reader.Update()
    assert reader.GetErrorCode() == 0
    return reader.GetOutput()


def array(fields: Any, name: str) -> NDArray:
    return support.vtk_to_numpy(fields.GetArray(name))


def names(fields: Any) -> set[str]:
    return {fields.GetArrayName(i) for i in range(fields.GetNumberOfArrays())}


def points(grid: Any) -> NDArray[np.float64]:
    return support.vtk_to_numpy(grid.GetPoints().GetData())


def volume(grid: Any, of: str = "Volume") -> NDArray[np.float64]:
    """Signed sizes of the cells."""
    sizes = verdict.vtkCellSizeFilter()
    sizes.SetInputData(grid)
    with quiet():
        sizes.Update()
    return array(sizes.GetOutput().GetCellData(), of)


def rows(files: Files) -> list[dict[str, str]]:
    return list(csv.DictReader(io.StringIO(files["regions.csv"].decode())))


@cache
def lumped() -> tuple[Analysis, Files]:
    analysis = analyse(PIEZO, lumped_system(PIEZO))
    return analysis, field_files(PIEZO, analysis)


@cache
def plane() -> tuple[StageModel, Analysis]:
    model = plane_model(SMALL, MeshSettings(order=2, neck_size=1.5))
    return model, analyse(SMALL, model.system)


def test_every_file_of_rigid_bodies_is_read_with_its_fields(tmp_path: Path) -> None:
    analysis, files = lumped()
    frames = [name for name in files if "frame" in name]
    assert len(frames) == 6 * 12
    grids = {
        name: read(data, tmp_path)
        for name, data in files.items()
        if name.endswith(".vtu") and name not in frames[2:]
    }
    assert len(grids) == 2 + 12 + 2
    first = grids["static-x.vtu"]
    for name, grid in grids.items():
        assert grid.GetNumberOfPoints() == first.GetNumberOfPoints()
        assert grid.GetNumberOfCells() == first.GetNumberOfCells()
        assert {grid.GetCellType(i) for i in range(0, grid.GetNumberOfCells(), 7)} == {10}
        assert names(grid.GetPointData()) == {"displacement"}
        wanted = {"region", "body"} | ({"hinge_stress"} if name.startswith("static") else set())
        assert names(grid.GetCellData()) == wanted
        assert array(grid.GetPointData(), "displacement").shape[1] == 3
    label = core.vtkDataArray.UNITS_LABEL()
    moved = first.GetPointData().GetArray("displacement").GetInformation()
    stress = first.GetCellData().GetArray("hinge_stress").GetInformation()
    assert (moved.Get(label), stress.Get(label)) == ("m", "Pa")
    for k, frequency in enumerate(analysis.modes["removed"].frequency_hz, start=1):
        general = grids[f"mode-{k:02d}.vtu"].GetFieldData()
        assert array(general, "frequency_hz").item() == frequency
        assert array(general, "mode").item() == k


def test_rigid_bodies_fill_the_volume_of_the_description(tmp_path: Path) -> None:
    _, files = lumped()
    grid = read(files["static-y.vtu"], tmp_path)
    found = volume(grid)
    assert found.min() > 0.0  # none is inside out
    body = array(grid.GetCellData(), "body")
    density = PIEZO.material.density
    for i, (name, properties) in enumerate(mass_properties(PIEZO).items()):
        own = properties.mass - sum(m.mass for m in PIEZO.body(name).extra_masses)
        # chords within 2 um of arcs of 1 to 11 mm, on bodies of some mm^2 with two notches
        assert found[body == i].sum() == pytest.approx(own / density, rel=1e-3)
    whole = sum(p.mass for p in mass_properties(PIEZO).values())
    whole -= sum(m.mass for b in PIEZO.bodies for m in b.extra_masses)
    assert found.sum() == pytest.approx(whole / density, rel=1e-4)
    low, high = points(grid).min(axis=0), points(grid).max(axis=0)
    assert (low[2], high[2]) == pytest.approx((-PIEZO.thickness / 2, PIEZO.thickness / 2))


def rigid(grid: Any, x: float, y: float, region: int) -> NDArray[np.float64]:
    """Displacement at a point that moves with the corners of a region."""
    kept = filters.vtkThreshold()
    kept.SetInputData(grid)
    kept.SetInputArrayToProcess(0, 0, 0, 1, "region")
    kept.SetLowerThreshold(region)
    kept.SetUpperThreshold(region)
    with quiet():
        kept.Update()
    out = kept.GetOutput()
    at, moved = points(out), array(out.GetPointData(), "displacement")
    basis = np.column_stack((np.ones(len(at)), at[:, 0] - x, at[:, 1] - y))
    return np.linalg.lstsq(basis, moved, rcond=None)[0][0]


@pytest.mark.parametrize("axis", ["x", "y"])
def test_displacement_at_each_probe_is_its_reading(axis: str, tmp_path: Path) -> None:
    analysis, files = lumped()
    grid = read(files[f"static-{axis}.vtu"], tmp_path)
    static = next(a.static for a in analysis.axes if a.axis == axis)
    order = [b.name for b in PIEZO.bodies]
    assert len(PIEZO.probes) > 1
    for probe in PIEZO.probes:
        moved = rigid(grid, *probe.at, order.index(probe.body))
        if probe.relative_to is not None:
            moved = moved - rigid(grid, *probe.at, order.index(probe.relative_to))
        reading = moved @ (np.cos(probe.direction), np.sin(probe.direction), 0.0)
        # rounding of the fit, for readings of some 10 um
        assert reading == pytest.approx(static.readings[probe.name], rel=1e-9, abs=1e-15)


def test_bodies_and_notches_hang_together_when_they_move(tmp_path: Path) -> None:
    _, files = lumped()
    leaf = leaf_beam()
    bent = field_files(leaf, analyse(leaf, lumped_system(leaf)))
    every = [files[name] for name in ("static-x.vtu", "mode-02.vtu", "mode-07.vtu")]
    every += [bent[f"mode-0{k}.vtu"] for k in (1, 2, 3)]
    for content in every:
        grid = read(content, tmp_path)
        moved = array(grid.GetPointData(), "displacement")
        # corners of two regions in one place, to a picometre, go to one place
        rest = np.round(points(grid) * 1e12).astype(np.int64)
        _, first, again = np.unique(rest, axis=0, return_index=True, return_inverse=True)
        shared = first[again.ravel()]
        assert np.count_nonzero(shared != np.arange(shared.size)) >= 6 * 2
        apart = np.linalg.norm(moved - moved[shared], axis=1).max()
        assert apart < 1e-9 * np.linalg.norm(moved, axis=1).max()


def leaf_beam() -> Stage:
    """A block on a leaf, at a generic angle, off the origin."""
    profile = Leaf(leaf_length=5.3e-3, neck_thickness=0.29e-3, notch_depth=1.1e-3)
    half, c, s = 0.5 * profile.length, np.cos(0.7), np.sin(0.7)

    def block(x0: float, x1: float) -> Loop:
        corners = ((x0, -1.6e-3), (x1, -1.6e-3), (x1, 1.6e-3), (x0, 1.6e-3))
        return Loop(tuple((4e-3 + c * x - s * y, -9e-3 + s * x + c * y) for x, y in corners))

    hinge = Hinge(
        name="leaf", bodies=("base", "arm"), at=(4e-3, -9e-3), direction=0.7, profile=profile
    )
    return Stage(
        name="leaf beam",
        thickness=6.2e-3,
        material=material("Al 7075-T6"),
        bodies=(
            Body(name="base", outline=block(-half - 9e-3, -half), fixed=True),
            Body(name="arm", outline=block(half, half + 11e-3)),
        ),
        hinges=(hinge,),
    )


def test_a_leaf_is_drawn_as_the_bar_that_it_is(tmp_path: Path) -> None:
    """Between clamped ends the middle line of a bar without load on it is of third order."""
    stage = leaf_beam()
    system = lumped_system(stage)
    files = field_files(stage, analyse(stage, system))
    grid = read(files["mode-01.vtu"], tmp_path)
    at, moved = points(grid), array(grid.GetPointData(), "displacement")
    hinge = stage.hinges[0]
    along = (at[:, :2] - hinge.at) @ (np.cos(0.7), np.sin(0.7))
    across = (at[:, :2] - hinge.at) @ (-np.sin(0.7), np.cos(0.7))
    inside = np.abs(along) < 0.7 * hinge.profile.length / 2.0
    v = moved[:, :2] @ (-np.sin(0.7), np.cos(0.7))
    cubic = np.polynomial.Polynomial.fit(along[inside], v[inside], 3)
    assert v[inside] == pytest.approx(cubic(along[inside]), abs=1e-12)
    # a section stays a section: its turn is the slope of the middle line
    slope = cubic.deriv()
    u = moved[:, :2] @ (np.cos(0.7), np.sin(0.7))
    for side in (1.0, -1.0):
        own = inside & (side * across > 0.0)
        middle = u[own] + across[own] * slope(along[own])
        line = np.polynomial.Polynomial.fit(along[own], middle, 1)
        assert middle == pytest.approx(line(along[own]), abs=1e-12)


def test_every_region_is_closed_and_whole(tmp_path: Path) -> None:
    """The surface of each region has no free edge, and encloses the volume of its cells."""
    _, files = lumped()
    grid = read(files["static-x.vtu"], tmp_path)
    regions = array(grid.GetCellData(), "region")
    sizes = volume(grid)
    for region in (0, 3, 7, 25, 40):
        kept = filters.vtkThreshold()
        kept.SetInputData(grid)
        kept.SetInputArrayToProcess(0, 0, 0, 1, "region")
        kept.SetLowerThreshold(region)
        kept.SetUpperThreshold(region)
        surface = surfaces.vtkDataSetSurfaceFilter()
        surface.SetInputConnection(kept.GetOutputPort())
        edges = filters.vtkFeatureEdges()
        edges.SetInputConnection(surface.GetOutputPort())
        edges.FeatureEdgesOff()
        edges.ManifoldEdgesOff()
        mass = filters.vtkMassProperties()
        mass.SetInputConnection(surface.GetOutputPort())
        with quiet():
            edges.Update()
            mass.Update()
        assert edges.GetOutput().GetNumberOfCells() == 0
        # its sum over triangles is in single precision in part
        assert mass.GetVolume() == pytest.approx(sizes[regions == region].sum(), rel=1e-5)


def test_stress_of_each_hinge_is_in_the_cells_of_its_notch(tmp_path: Path) -> None:
    analysis, files = lumped()
    grid = read(files["static-x.vtu"], tmp_path)
    stress = array(grid.GetCellData(), "hinge_stress")
    region = array(grid.GetCellData(), "region")
    table = rows(files)
    assert [int(row["region"]) for row in table] == list(range(len(table)))
    by_hinge = analysis.hinge_stress["x"]
    for row in table:
        values = set(stress[region == int(row["region"])])
        hinge = re.fullmatch(r"notch (.*) [ab]", row["region name"])
        assert values == {by_hinge[hinge[1]] if hinge else 0.0}
        assert PIEZO.bodies[int(row["body"])].name == row["body name"]
    assert stress.max() == max(by_hinge.values())


def test_period_of_a_mode_swings_about_rest(tmp_path: Path) -> None:
    _, files = lumped()
    root = ET.fromstring(files["mode-02-period.pvd"])
    listed = [(float(d.get("timestep", "")), d.get("file", "")) for d in root.iter("DataSet")]
    assert [t for t, _ in listed] == pytest.approx([k / 12 for k in range(12)], abs=1e-9)
    still = read(files["mode-02.vtu"], tmp_path)
    rest, shape = points(still), array(still.GetPointData(), "displacement")
    assert np.linalg.norm(shape, axis=1).max() == pytest.approx(1.0, rel=1e-12)
    frames = [read(files[name], tmp_path) for _, name in listed[::3]]
    size = array(frames[0].GetFieldData(), "exaggerated_to_m").item()
    assert size == pytest.approx(0.02 * np.linalg.norm(np.ptp(rest, axis=0)))
    for frame, part in zip(frames, (1.0, 0.0, -1.0, 0.0), strict=True):
        assert points(frame) == pytest.approx(rest + part * size * shape, abs=1e-15)
        assert array(frame.GetPointData(), "displacement") == pytest.approx(part * shape, abs=1e-15)
    everything = ET.fromstring(files["modes.pvd"])
    assert {d.get("file", "") for d in everything.iter("DataSet")} <= set(files)


def test_files_of_finite_elements_are_read_and_move(tmp_path: Path) -> None:
    model, analysis = plane()
    files = field_files(SMALL, analysis, mesh=model)
    assert {"static-x.vtu", "mode-12.vtu", "modes.pvd", "regions.csv"} <= set(files)
    grid = read(files["static-x.vtu"], tmp_path)
    area = sum(p.mass for p in mass_properties(SMALL).values())
    area -= sum(m.mass for b in SMALL.bodies for m in b.extra_masses)
    area /= SMALL.material.density * SMALL.thickness
    # curved edges in two straight parts each
    assert volume(grid, "Area").sum() == pytest.approx(area, rel=1e-3)
    assert names(grid.GetPointData()) == {"displacement", "von_mises", "stress"}
    assert grid.GetPointData().GetArray("stress").GetComponentName(3) == "XY"
    assert not any("frame" in name for name in files)


def test_rigid_bodies_move_as_those_of_finite_elements_do(tmp_path: Path) -> None:
    """One analysis drawn twice: on its mesh, and as rigid bodies by the ports of the system."""
    model, analysis = plane()
    drawn = read(field_files(SMALL, analysis)["static-x.vtu"], tmp_path)
    files = field_files(SMALL, analysis, mesh=model)
    meshed = read(files["static-x.vtu"], tmp_path)
    table = {r["region name"]: int(r["region"]) for r in rows(files)}
    largest = np.abs(array(meshed.GetPointData(), "displacement")).max()
    for i, body in enumerate(SMALL.bodies):
        x, y = mass_properties(SMALL)[body.name].centre
        # bodies of finite elements bend a little: their motion on the whole is within 1 %
        fitted = rigid(meshed, x, y, table[f"body {body.name}"])
        assert rigid(drawn, x, y, i) == pytest.approx(fitted, abs=0.01 * largest)


def test_odd_names_leave_the_files_readable(tmp_path: Path) -> None:
    stage = leaf_beam()
    odd = replace(stage, name="a---b <&> \x07 \n µ-", bodies=stage.bodies)
    files = field_files(odd, analyse(odd, lumped_system(odd)))
    for name, content in files.items():
        if name.endswith(".vtu"):
            assert read(content, tmp_path).GetNumberOfCells() > 0
        elif name.endswith(".pvd"):
            assert ET.fromstring(content).get("type") == "Collection"
    assert "a- - -b <&>" in files["mode-01.vtu"].decode().split("\n")[1]


@pytest.mark.slow
def test_files_of_a_solid_are_read_and_fill_its_volume(tmp_path: Path) -> None:
    model = solid_model(SMALL, MeshSettings(order=2, neck_size=1.5), modes=(2, 2))
    files = field_files(SMALL, analyse(SMALL, model.system), mesh=model)
    mass = sum(p.mass for p in mass_properties(SMALL).values())
    mass -= sum(m.mass for b in SMALL.bodies for m in b.extra_masses)
    rest = read(files["mode-01.vtu"], tmp_path)
    found = volume(rest)
    # which way round a wedge is right side out has changed between versions of the toolkit
    assert np.all(found > 0.0) or np.all(found < 0.0)
    assert abs(found.sum()) == pytest.approx(mass / SMALL.material.density, rel=1e-2)


def test_the_mesh_of_another_analysis_is_refused() -> None:
    analysis, _ = lumped()
    model, _ = plane()
    with pytest.raises(ModelError, match="give the mesh of the analysis"):
        field_files(PIEZO, analysis, mesh=model)
