"""Files for ParaView: read back by other means, they hold the numbers of the model."""

import base64
import csv
import io
import xml.etree.ElementTree as ET
import zlib
from dataclasses import replace

import ngsolve as ng
import numpy as np
import pytest
from numpy.typing import NDArray

from flexstage.elasticity.shapes import METRE
from flexstage.export import field_files
from flexstage.fem import MeshSettings, StageModel
from flexstage.stage.designs import design
from flexstage.system import Analysis
from tests import meshed_stages

STAGE = design("parallelogram")
_KINDS = {"Float64": "<f8", "Int64": "<i8", "UInt8": "|u1"}


@pytest.fixture(scope="module")
def plane() -> tuple[StageModel, Analysis]:
    model = meshed_stages.plane(MeshSettings(order=3))
    return model, meshed_stages.analysed(model)


@pytest.fixture(scope="module")
def solid() -> tuple[StageModel, Analysis]:
    model = meshed_stages.coarse_solid()
    return model, meshed_stages.analysed(model)


class Grid:
    """What a file holds, read by the words of the format alone."""

    def __init__(self, content: bytes) -> None:
        root = ET.fromstring(content)
        assert root.get("type") == "UnstructuredGrid"
        assert root.get("header_type") == "UInt64"
        assert root.get("byte_order") == "LittleEndian"
        assert root.get("compressor") == "vtkZLibDataCompressor"
        piece = root.find(".//Piece")
        assert piece is not None
        self.points = self._read(piece.find("Points/DataArray"))
        self.cells = {a.get("Name"): self._read(a).ravel() for a in piece.iterfind("Cells/*")}
        self.point = {a.get("Name"): self._read(a) for a in piece.iterfind("PointData/*")}
        self.cell = {a.get("Name"): self._read(a).ravel() for a in piece.iterfind("CellData/*")}
        self.general = {
            a.get("Name"): self._read(a).item() for a in root.iterfind(".//FieldData/*")
        }
        self.names = {a.get("Name"): a for a in piece.iterfind("PointData/*")}
        assert len(self.points) == int(piece.get("NumberOfPoints", ""))
        assert len(self.cells["types"]) == int(piece.get("NumberOfCells", ""))
        assert all(len(v) == len(self.points) for v in self.point.values())
        assert all(len(v) == len(self.cells["types"]) for v in self.cell.values())

    @staticmethod
    def _read(array: ET.Element | None) -> NDArray:
        assert array is not None
        assert array.get("format") == "binary"
        text = (array.text or "").strip()
        # blocks, size of a block, size of a last one that is not full, compressed size of each
        header = np.frombuffer(base64.b64decode(text[:44]), dtype="<u8")
        assert header[0] == 1
        raw = zlib.decompress(base64.b64decode(text[44:]))
        assert len(raw) == header[1]
        values = np.frombuffer(raw, dtype=_KINDS[array.get("type", "")])
        return values.reshape(-1, int(array.get("NumberOfComponents", "1")))

    def corners(self) -> NDArray:
        """Corners of each cell, shape (m, k)."""
        (step,) = set(np.diff(self.cells["offsets"], prepend=0).tolist())
        return self.cells["connectivity"].reshape(-1, step)


def test_statics_of_the_plane_are_those_of_the_continuum(
    plane: tuple[StageModel, Analysis],
) -> None:
    model, analysis = plane
    files = field_files(STAGE, analysis, mesh=model)
    assert set(files) == {
        "static-x.vtu", "modes.pvd", "regions.csv", *(f"mode-{k:02d}.vtu" for k in range(1, 13)),
    }  # fmt: skip
    grid = Grid(files["static-x.vtu"])
    axis, half = analysis.axes[0], model.problems[0]
    assert grid.general["input_displacement_m"] == axis.input_displacement
    assert set(grid.cells["types"]) == {5}
    assert set(grid.point) == {"displacement", "von_mises", "stress"}
    assert not grid.points[:, 2].any()
    # the field at random corners, looked up on the mesh; where regions meet, and at the corners
    # of elements, the mesh gives the same displacement, but another stress in each element
    u = half.continuum.field(half.basis @ axis.static.q)
    mesh = half.continuum.mesh
    some = np.random.default_rng(5).choice(len(grid.points), 40, replace=False)
    largest = np.abs(grid.point["displacement"]).max()
    for k in some:
        x, y = grid.points[k, :2] * METRE
        if mesh.Contains(x, y):
            expected = (*u(mesh(x, y)), 0.0)
            # to the tolerance of the search for the point
            assert grid.point["displacement"][k] == pytest.approx(expected, abs=1e-5 * largest)
    s = grid.point["stress"]
    labels = [grid.names["stress"].get(f"ComponentName{i}") for i in range(6)]
    assert labels == ["XX", "YY", "ZZ", "XY", "YZ", "XZ"]
    xx, yy, zz, xy, yz, xz = s.T
    mises = np.sqrt(0.5 * ((xx - yy) ** 2 + (yy - zz) ** 2 + (zz - xx) ** 2) + 3.0 * xy**2)
    assert not yz.any()
    assert not xz.any()
    assert grid.point["von_mises"].ravel() == pytest.approx(mises, rel=1e-12, abs=1.0)
    worst = max(axis.static.hinge_stress.values())
    assert grid.point["von_mises"].max() == pytest.approx(worst, rel=0.1)


def test_stress_has_its_components_in_their_places(plane: tuple[StageModel, Analysis]) -> None:
    model, analysis = plane
    grid = Grid(field_files(STAGE, analysis, mesh=model)["static-x.vtu"])
    half = model.problems[0]
    mesh = half.continuum.mesh
    vertices = np.array([v.point for v in mesh.vertices])
    stress = half.continuum.stress(half.basis @ analysis.axes[0].static.q)
    for number in (3, 11, 42):
        triangle = [v.nr for v in mesh[ng.ElementId(ng.VOL, number)].vertices]
        middle = vertices[triangle].mean(axis=0) / METRE
        # with three divisions a corner lies near the middle of each element, in no other one
        k = int(np.argmin(np.hypot(*(grid.points[:, :2] - middle).T)))
        at = mesh(*(grid.points[k, :2] * METRE))
        six = [stress[i, j](at) for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2))]
        assert grid.point["stress"][k] == pytest.approx(
            six, rel=1e-6, abs=1e-9 * max(map(abs, six))
        )


@pytest.mark.slow
def test_cells_of_three_dimensions_fill_the_whole_plate(
    solid: tuple[StageModel, Analysis],
) -> None:
    model, analysis = solid
    grid = Grid(field_files(STAGE, analysis, mesh=model)["static-x.vtu"])
    assert set(grid.cells["types"]) == {13}
    a, b, c, d, e, f = np.moveaxis(grid.points[grid.corners()], 1, 0)
    # three tetrahedra each; the first face of a wedge looks outwards
    six_times = (
        np.einsum("ij,ij->i", np.cross(b - a, c - a), a - d)
        + np.einsum("ij,ij->i", np.cross(b - d, c - d), d - e)
        + np.einsum("ij,ij->i", np.cross(c - d, e - d), f - d)
    )
    assert (six_times > 0.0).all()
    mesh = model.problems[0].continuum.mesh
    volume = 2.0 * float(ng.Integrate(ng.CoefficientFunction(1.0), mesh)) / METRE**3
    # chords in place of arcs
    assert six_times.sum() / 6.0 == pytest.approx(volume, rel=1e-3)
    z = grid.points[:, 2]
    assert (z.min(), z.max()) == pytest.approx((-STAGE.thickness / 2, STAGE.thickness / 2))
    # nothing acts on the free faces of the plate; the stress is that of the mesh, so in the mean
    free = np.abs(np.abs(z) - z.max()) < 1e-9
    through = np.abs(grid.point["stress"][free][:, [2, 4, 5]]).mean(axis=0)
    assert (through < 0.02 * grid.point["von_mises"][free].max()).all()


def test_modes_are_scaled_and_named(solid: tuple[StageModel, Analysis]) -> None:
    model, analysis = solid
    files = field_files(STAGE, analysis, mesh=model)
    found = analysis.modes["removed"]
    sets = ET.fromstring(files["modes.pvd"]).findall(".//DataSet")
    assert [s.get("file") for s in sets] == [f"mode-{k + 1:02d}.vtu" for k in range(12)]
    assert [s.get("timestep") for s in sets] == [str(k + 1) for k in range(12)]
    for k, s in enumerate(sets):
        grid = Grid(files[s.get("file", "")])
        assert grid.general == {"frequency_hz": found.frequency_hz[k], "mode": k + 1.0}
        size = np.linalg.norm(grid.point["displacement"], axis=1)
        assert size.max() == pytest.approx(1.0, rel=1e-12)
    # the second of this stage lifts the platform: as much below the middle plane as above it
    lifted = Grid(files["mode-02.vtu"])
    u, z = lifted.point["displacement"], lifted.points[:, 2]
    assert np.abs(u[:, 2]).max() > 0.9
    k = int(np.argmax(np.abs(u[:, 2])))
    same = np.hypot(*(lifted.points[:, :2] - lifted.points[k, :2]).T) < 1e-9
    top, bottom = same & (z > 0.99 * z.max()), same & (z < 0.99 * z.min())
    assert u[top][0, 2] == pytest.approx(u[bottom][0, 2], rel=1e-12)
    assert u[top][0, 1] == pytest.approx(-u[bottom][0, 1], rel=1e-12)


def test_cells_know_their_body(plane: tuple[StageModel, Analysis]) -> None:
    model, analysis = plane
    files = field_files(STAGE, analysis, mesh=model)
    grid = Grid(files["static-x.vtu"])
    rows = list(csv.DictReader(io.StringIO(files["regions.csv"].decode())))
    assert [int(r["region"]) for r in rows] == list(range(len(rows)))
    # four bodies, and two halves of each of four notches
    assert len(rows) == len(STAGE.bodies) + 2 * len(STAGE.hinges)
    pairs = {(int(r["region"]), int(r["body"])) for r in rows}
    assert set(zip(grid.cell["region"].tolist(), grid.cell["body"].tolist(), strict=True)) == pairs
    corners = grid.points[grid.corners()]
    areas = 0.5 * np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, 2]
    assert (areas > 0.0).all()
    for row in rows:
        name = row["region name"]
        assert STAGE.bodies[int(row["body"])].name == row["body name"]
        assert row["body name"] in name or name.startswith("notch")
        area = areas[grid.cell["region"] == int(row["region"])].sum()
        expected = model.problems[0].continuum.measure(region=name)
        # a half notch between arcs loses most by chords
        assert area == pytest.approx(expected, rel=5e-3)


def test_names_of_axes_become_names_of_files(plane: tuple[StageModel, Analysis]) -> None:
    model, analysis = plane
    axis = analysis.axes[0]
    named = replace(
        analysis, axes=tuple(replace(axis, axis=n) for n in ("../a", "x+", "X+", "θ z"))
    )
    files = [n for n in field_files(STAGE, named, mesh=model) if n.startswith("static")]
    assert files == ["static-a.vtu", "static-x+.vtu", "static-X+-2.vtu", "static-θ-z.vtu"]
