"""Statics, modes and animations of any model as files for ParaView."""

import base64
import zlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from html import escape
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from flexstage.base.arrays import Array
from flexstage.base.errors import ModelError
from flexstage.base.version import __version__
from flexstage.export.body_cells import body_cells
from flexstage.export.request import StageExport
from flexstage.files.names import file_names
from flexstage.files.plain import csv_text
from flexstage.stage import Stage
from flexstage.system import Analysis, AxisAnalysis

if TYPE_CHECKING:
    from flexstage.fem import StageModel

# cell types by number of corners: triangle, tetrahedron, wedge
_CELL_TYPES = {3: 5, 4: 10, 6: 13}

_HEAD = '<?xml version="1.0"?>\n'
_GRID = (
    '<VTKFile type="UnstructuredGrid" version="1.0" byte_order="LittleEndian" '
    'header_type="UInt64" compressor="vtkZLibDataCompressor">'
)

_KINDS = {"f": ("Float64", "<f8"), "i": ("Int64", "<i8"), "u": ("UInt8", "|u1")}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Values:
    """Values at points, in cells, or of the entire grid."""

    values: NDArray
    """Values, shape (n,) or (n, components)."""
    unit: str = ""
    """Unit; empty for counts and indices."""
    components: tuple[str, ...] = field(default=())
    """Names of the components; none for a scalar or a vector."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PackedCells:
    """Encoded cells with their values, which several grids can share."""

    count: int
    """Number of cells."""
    cells: str
    """Encoded corners."""
    values: str
    """Encoded values of the cells."""

    def and_values(self, in_cells: Mapping[str, Values]) -> "PackedCells":
        """Return the cells with additional values."""
        return replace(self, values=self.values + _arrays(in_cells))


def packed_cells(cells: NDArray[np.integer], in_cells: Mapping[str, Values]) -> PackedCells:
    """Return encoded triangles, tetrahedra or wedges of 3, 4 or 6 corners, with values."""
    count, corners = cells.shape
    parts = {
        "connectivity": Values(values=cells.ravel()),
        "offsets": Values(values=corners * np.arange(1, count + 1)),
        "types": Values(values=np.full(count, _CELL_TYPES[corners], dtype=np.uint8)),
    }
    return PackedCells(count=count, cells=_arrays(parts), values="").and_values(in_cells)


def grid_file(
    points: NDArray[np.float64],
    cells: PackedCells,
    *,
    at_points: Mapping[str, Values],
    about: Mapping[str, Values],
    remark: str,
) -> bytes:
    """Return an unstructured grid (``.vtu``) of points [m] with values at points and of the grid.

    Units use the label of the toolkit; the remark is for readers of the file in an editor.
    """
    text = [
        f"{_HEAD}<!-- {_comment(remark)} -->",
        _GRID,
        f"<UnstructuredGrid>\n<FieldData>\n{_arrays(about)}</FieldData>",
        f'<Piece NumberOfPoints="{len(points)}" NumberOfCells="{cells.count}">',
        f"<Points>\n{_arrays({'points': Values(values=points, unit='m')})}</Points>",
        f"<Cells>\n{cells.cells}</Cells>",
        f"<PointData>\n{_arrays(at_points)}</PointData>",
        f"<CellData>\n{cells.values}</CellData>",
        "</Piece>\n</UnstructuredGrid>\n</VTKFile>\n",
    ]
    return "\n".join(text).encode()


def collection_file(files: Sequence[str], times: Sequence[float], *, remark: str) -> bytes:
    """Return a collection of grids (``.pvd``), one for each time."""
    sets = "".join(
        f'<DataSet timestep="{time:.10g}" group="" part="0" file="{escape(name)}"/>\n'
        for name, time in zip(files, times, strict=True)
    )
    return (
        f"{_HEAD}<!-- {_comment(remark)} -->\n"
        '<VTKFile type="Collection" version="1.0" byte_order="LittleEndian">\n'
        f"<Collection>\n{sets}</Collection>\n</VTKFile>\n"
    ).encode()


def _comment(remark: str) -> str:
    plain = "".join(c if c.isprintable() else " " for c in remark)
    # a comment must not hold two dashes
    while "--" in plain:
        plain = plain.replace("--", "- -")
    return f"{plain}; written by flexstage {__version__}"


def _arrays(fields: Mapping[str, Values]) -> str:
    return "".join(f"{_data_array(name, values)}\n" for name, values in fields.items())


def _data_array(name: str, numbers: Values) -> str:
    """Return encoded numbers: a header of one block, and the block, compressed."""
    values = np.asarray(numbers.values)
    kind, wide = _KINDS[values.dtype.kind]
    raw = np.ascontiguousarray(values, dtype=wide).tobytes()
    packed = zlib.compress(raw, 6)
    header = np.array([1, len(raw), 0, len(packed)], dtype="<u8").tobytes()
    data = base64.b64encode(header).decode() + base64.b64encode(packed).decode()
    width = values.shape[1] if values.ndim == 2 else 1
    labels = "".join(f' ComponentName{i}="{n}"' for i, n in enumerate(numbers.components))
    unit = (
        f'<InformationKey name="UNITS_LABEL" location="vtkDataArray">{escape(numbers.unit)}'
        "</InformationKey>"
        if numbers.unit
        else ""
    )
    return (
        f'<DataArray type="{kind}" Name="{escape(name)}" NumberOfComponents="{width}"{labels}'
        f' NumberOfTuples="{values.shape[0]}" format="binary">{data}{unit}</DataArray>'
    )


# frames of one period of a mode, and modes that have them
_FRAMES, _ANIMATED = 12, 6
# largest motion in animations, as share of the diagonal of the stage
_LARGEST = 0.02


Fields = dict[str, Values]

# of a symmetric tensor the format has xx, yy, zz, xy, yz, xz; ours is xx, yy, zz, yz, xz, xy
_ORDER = [0, 1, 2, 5, 3, 4]
_COMPONENTS = ("XX", "YY", "ZZ", "XY", "YZ", "XZ")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _StageGrid:
    """Grid of a stage at rest, and its fields for a state of the system."""

    points: Array
    cells: PackedCells
    regions: Sequence[tuple[str, int]]
    """Name and body of each region."""
    displacement: Callable[[Array], Array]
    """Displacement of the points [m] for coordinates of the system."""
    static: Callable[[AxisAnalysis], tuple[Fields, Fields]]
    """Fields at points and in cells at full stroke."""


def field_files(
    stage: Stage,
    analysis: Analysis,
    *,
    mesh: "StageModel | None" = None,
) -> dict[str, bytes]:
    """Return statics and modes of a model as files of the Visualization Toolkit.

    ``static-AXIS.vtu``: each axis at full stroke, with ``displacement`` [m]; of rigid bodies with
    ``hinge_stress`` [Pa], the largest of each hinge in all cells of its notch; of a mesh with
    ``von_mises`` [Pa] and ``stress`` [Pa] (xx, yy, zz, xy, yz, xz). ``mode-NN.vtu``:
    ``displacement`` normalised to its maximum [1], its frequency as field data ``frequency_hz``;
    ``modes.pvd`` opens all modes, with the number of the mode as time. Every cell has numbers of
    its ``region`` and ``body``, whose names are in ``regions.csv``. Points are in metres.

    The mesh is that of the finite elements of the analysis. Each edge of an element has as many
    parts as its order, but at most 4, in the plane, and 2 in three dimensions. Without a mesh,
    bodies are drawn as rigid bodies, and the lowest modes are animated: ``mode-NN-period.pvd`` with
    its ``mode-NN-frame-KK.vtu`` is one period of a mode, with the fraction of the period as time.
    Its points are displaced, by at most 2 % of the diagonal of the stage; bodies may seem to
    overlap.

    Notes
    -----
    Validity: that of the model. Rigid bodies are drawn over the full thickness, arcs by chords
    within 2 um. A notch between two bodies is drawn as a bent bar, for illustration only; its
    stress is the largest one. A mesh in three dimensions has its full thickness, mirrored from the
    meshed half. Stress is averaged at corners within a region, never across regions.

    Examples
    --------
    >>> from flexstage.stage.designs import design
    >>> from flexstage.lumped import lumped_system
    >>> from flexstage.system import analyse
    >>> stage = design("parallelogram")
    >>> files = field_files(stage, analyse(stage, lumped_system(stage)))
    >>> [name for name in files if "frame" in name][-1]
    'mode-06-frame-12.vtu'
    """
    if mesh is not None:
        _require_analysed(mesh, analysis)
        return _still(analysis, _of_mesh(mesh))
    grid = _of_bodies(stage, analysis)
    return _still(analysis, grid) | _moving(analysis, grid)


# ------------------------------------------------------------------ finite elements


def _require_analysed(mesh: "StageModel", analysis: Analysis) -> None:
    if mesh.system.order != analysis.system.order or mesh.system.model != analysis.system.model:
        raise ModelError(
            f"the mesh belongs to a {mesh.system.model} model with {mesh.system.order} "
            f"coordinates, the analysis to a {analysis.system.model} model with "
            f"{analysis.system.order}: give the mesh of the analysis"
        )


def _of_mesh(mesh: "StageModel") -> _StageGrid:
    from flexstage.fem.sampling import Sampler

    solid = mesh.problems[0].continuum.dimension == 3
    divisions = 2 if solid else min(mesh.mesh_settings.order, 4)
    sampler = Sampler(model=mesh, divisions=divisions, extent="whole", seams=True)
    rest = sampler.read(np.zeros(mesh.system.order), stress=False)
    regions = [(name, sampler.bodies[name]) for name in sampler.regions]

    def static(axis: AxisAnalysis) -> tuple[Fields, Fields]:
        sample = sampler.read(axis.static.q)
        assert sample.stress is not None
        at_points = {
            "displacement": Values(values=sample.displacement, unit="m"),
            "von_mises": Values(values=sample.von_mises, unit="Pa"),
            "stress": Values(values=sample.stress[:, _ORDER], unit="Pa", components=_COMPONENTS),
        }
        return at_points, {}

    return _StageGrid(
        points=rest.points,
        cells=_packed(rest.cells, rest.region, regions),
        regions=regions,
        displacement=lambda q: sampler.read(q, stress=False).displacement,
        static=static,
    )


# ------------------------------------------------------------------ rigid bodies


def _of_bodies(stage: Stage, analysis: Analysis) -> _StageGrid:
    cells = body_cells(stage)
    regions = list(zip(cells.regions, cells.body.tolist(), strict=True))

    def displacement(q: Array) -> Array:
        return cells.displacement(analysis.system, q)

    def static(axis: AxisAnalysis) -> tuple[Fields, Fields]:
        stress = cells.hinge_values(axis.static.hinge_stress)
        moved = Values(values=displacement(axis.static.q), unit="m")
        return {"displacement": moved}, {"hinge_stress": Values(values=stress, unit="Pa")}

    return _StageGrid(
        points=cells.points,
        cells=_packed(cells.cells, cells.region, regions),
        regions=regions,
        displacement=displacement,
        static=static,
    )


# ------------------------------------------------------------------ the files


def _still(analysis: Analysis, grid: _StageGrid) -> dict[str, bytes]:
    """Return statics and modes, with the names of the regions."""
    files: dict[str, bytes] = {}
    title = f"{analysis.system.model} model of {analysis.stage.name}"
    for name, axis in zip(file_names([a.axis for a in analysis.axes]), analysis.axes, strict=True):
        at_points, in_cells = grid.static(axis)
        fields = ", ".join(f"{n} [{v.unit}]" for n, v in (at_points | in_cells).items())
        files[f"static-{name}.vtu"] = grid_file(
            grid.points,
            grid.cells.and_values(in_cells),
            at_points=at_points,
            about={"input_displacement_m": _one(axis.input_displacement, "m")},
            remark=f"{title}, axis {axis.axis} at full stroke: {fields}",
        )
    names = []
    shapes = analysis.modes["removed"]
    for k, frequency in enumerate(shapes.frequency_hz.tolist(), start=1):
        motion = _normalised(grid.displacement(shapes.shapes[:, k - 1]))
        names.append(f"mode-{k:02d}.vtu")
        files[names[-1]] = grid_file(
            grid.points,
            grid.cells,
            at_points={"displacement": Values(values=motion)},
            about={"frequency_hz": _one(frequency, "Hz"), "mode": _one(float(k))},
            remark=f"{title}, drives removed, mode {k} at {frequency:.6g} Hz: displacement "
            "normalised to its maximum",
        )
    if names:
        files["modes.pvd"] = collection_file(
            names,
            range(1, len(names) + 1),
            remark=f"modes of the {title}; time: number of the mode",
        )
    files["regions.csv"] = _region_table(analysis.stage, grid.regions)
    return files


def _moving(analysis: Analysis, grid: _StageGrid) -> dict[str, bytes]:
    """Return frames of one period of the lowest modes."""
    size = _LARGEST * float(np.linalg.norm(np.ptp(grid.points, axis=0)))
    files: dict[str, bytes] = {}
    title = f"{analysis.system.model} model of {analysis.stage.name}"
    shapes = analysis.modes["removed"]
    for k, frequency in enumerate(shapes.frequency_hz[:_ANIMATED].tolist(), start=1):
        motion = _normalised(grid.displacement(shapes.shapes[:, k - 1]))
        names, times = [], [i / _FRAMES for i in range(_FRAMES)]
        for i, time in enumerate(times, start=1):
            displacement = np.cos(2.0 * np.pi * time) * motion
            names.append(f"mode-{k:02d}-frame-{i:02d}.vtu")
            files[names[-1]] = grid_file(
                grid.points + size * displacement,
                grid.cells,
                at_points={"displacement": Values(values=displacement)},
                about={
                    "frequency_hz": _one(frequency, "Hz"),
                    "mode": _one(float(k)),
                    "exaggerated_to_m": _one(size, "m"),
                },
                remark=f"{title}, mode {k} at {frequency:.6g} Hz, {time:.4g} of a period, largest "
                f"motion drawn as {size:.4g} m",
            )
        files[f"mode-{k:02d}-period.pvd"] = collection_file(
            names,
            times,
            remark=f"{title}, drives removed: one period of mode {k} at {frequency:.6g} Hz; time: "
            "fraction of the period",
        )
    return files


def _packed(
    cells: NDArray[np.intp], region: NDArray[np.intp], regions: Sequence[tuple[str, int]]
) -> PackedCells:
    bodies = np.array([body for _, body in regions], dtype=np.intp)
    in_cells = {"region": Values(values=region), "body": Values(values=bodies[region])}
    return packed_cells(cells, in_cells)


def _normalised(displacement: Array) -> Array:
    return displacement / (float(np.linalg.norm(displacement, axis=1).max()) or 1.0)


def _one(value: float, unit: str = "") -> Values:
    return Values(values=np.array([value]), unit=unit)


def _region_table(stage: Stage, regions: Sequence[tuple[str, int]]) -> bytes:
    """Return the names of regions and bodies as CSV."""
    rows = ((i, name, body, stage.bodies[body].name) for i, (name, body) in enumerate(regions))
    return csv_text([("region", "region name", "body", "body name"), *rows]).encode()


def export(stage_export: StageExport) -> dict[str, bytes]:
    """Return the files of the format."""
    return field_files(stage_export.stage, stage_export.analysis, mesh=stage_export.mesh)
