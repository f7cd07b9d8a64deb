"""Statics and modes of any model as files for ParaView and its like, with modes that move."""

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
from flexstage.export.request import StageExport
from flexstage.export.vtu.body_cells import body_cells
from flexstage.files.names import file_names
from flexstage.files.plain import csv_text
from flexstage.stage import Stage
from flexstage.system import Analysis, AxisAnalysis

if TYPE_CHECKING:
    from flexstage.fem import StageModel

# types of cells by their corners: triangle, tetrahedron, wedge
_CELL_TYPES = {3: 5, 4: 10, 6: 13}

_HEAD = '<?xml version="1.0"?>\n'
_GRID = (
    '<VTKFile type="UnstructuredGrid" version="1.0" byte_order="LittleEndian" '
    'header_type="UInt64" compressor="vtkZLibDataCompressor">'
)

_KINDS = {"f": ("Float64", "<f8"), "i": ("Int64", "<i8"), "u": ("UInt8", "|u1")}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Values:
    """Numbers at points, in cells, or of the whole grid."""

    values: NDArray
    """The numbers, shape (n,) or (n, components)."""
    unit: str = ""
    """Their unit; empty for numbers of something."""
    components: tuple[str, ...] = field(default=())
    """Names of the components; none for a number or a vector."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PackedCells:
    """Cells and what is in them, written already: many grids can share them."""

    count: int
    """Number of cells."""
    cells: str
    """Their corners, as the format has them."""
    values: str
    """The values in them, as the format has them."""

    def and_values(self, in_cells: Mapping[str, Values]) -> "PackedCells":
        """Return the same cells with more values."""
        _require_rows("cell", self.count, in_cells)
        return replace(self, values=self.values + _arrays(in_cells))


def packed_cells(cells: NDArray[np.integer], in_cells: Mapping[str, Values]) -> PackedCells:
    """Write triangles, tetrahedra or wedges, by their 3, 4 or 6 corners, with values in each."""
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
    """Write an unstructured grid (``.vtu``) over points [m], with values at them and of the whole.

    A unit goes with its values as the toolkit's own label; the remark is for people who open the
    file in an editor.
    """
    _require_rows("point", len(points), at_points)
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
    """Write a list of grids (``.pvd``), one for each time."""
    sets = "".join(
        f'<DataSet timestep="{time:.10g}" group="" part="0" file="{escape(name)}"/>\n'
        for name, time in zip(files, times, strict=True)
    )
    return (
        f"{_HEAD}<!-- {_comment(remark)} -->\n"
        '<VTKFile type="Collection" version="1.0" byte_order="LittleEndian">\n'
        f"<Collection>\n{sets}</Collection>\n</VTKFile>\n"
    ).encode()


def _require_rows(noun: str, rows: int, fields: Mapping[str, Values]) -> None:
    for name, values in fields.items():
        if len(values.values) != rows:
            raise ModelError(
                f"'{name}' must have one row for each of {rows} {noun}s, got {len(values.values)}"
            )


def _comment(remark: str) -> str:
    plain = "".join(c if c.isprintable() else " " for c in remark)
    # a comment must not hold two dashes
    while "--" in plain:
        plain = plain.replace("--", "- -")
    return f"{plain}; written by flexstage {__version__}"


def _arrays(fields: Mapping[str, Values]) -> str:
    return "".join(f"{_data_array(name, values)}\n" for name, values in fields.items())


def _data_array(name: str, held: Values) -> str:
    """Write numbers: a header of one block, and the block, compressed."""
    values = np.asarray(held.values)
    kind, wide = _KINDS[values.dtype.kind]
    raw = np.ascontiguousarray(values, dtype=wide).tobytes()
    packed = zlib.compress(raw, 6)
    header = np.array([1, len(raw), 0, len(packed)], dtype="<u8").tobytes()
    data = base64.b64encode(header).decode() + base64.b64encode(packed).decode()
    width = values.shape[1] if values.ndim == 2 else 1
    labels = "".join(f' ComponentName{i}="{n}"' for i, n in enumerate(held.components))
    unit = (
        f'<InformationKey name="UNITS_LABEL" location="vtkDataArray">{escape(held.unit)}'
        "</InformationKey>"
        if held.unit
        else ""
    )
    return (
        f'<DataArray type="{kind}" Name="{escape(name)}" NumberOfComponents="{width}"{labels}'
        f' NumberOfTuples="{values.shape[0]}" format="binary">{data}{unit}</DataArray>'
    )


_MOST_FRAMES = 360
# motion that is drawn at most, as part of the diagonal of the stage
_LARGEST = 0.02


Fields = dict[str, Values]

# of a symmetric tensor the format has xx, yy, zz, xy, yz, xz; ours is xx, yy, zz, yz, xz, xy
_ORDER = [0, 1, 2, 5, 3, 4]
_COMPONENTS = ("XX", "YY", "ZZ", "XY", "YZ", "XZ")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Drawn:
    """A stage in cells at rest, and what is seen of a state of its system."""

    points: Array
    cells: PackedCells
    regions: Sequence[tuple[str, int]]
    """Name of each region, and the body that it is a part of."""
    displacement: Callable[[Array], Array]
    """Of the points [m], by the coordinates of the system."""
    static: Callable[[AxisAnalysis], tuple[Fields, Fields]]
    """At points and in cells, at full stroke."""


def field_files(
    stage: Stage,
    analysis: Analysis,
    *,
    mesh: "StageModel | None" = None,
    frames: int | None = None,
    animated: int = 6,
    divisions: int | None = None,
) -> dict[str, bytes]:
    """Return statics and modes of a model as files of the Visualization Toolkit.

    ``static-AXIS.vtu``: each axis at full stroke, with ``displacement`` [m]; of rigid bodies with
    ``hinge_stress`` [Pa], the largest of each hinge in all cells of its notch; of a mesh with
    ``von_mises`` [Pa] and ``stress`` [Pa] (xx, yy, zz, xy, yz, xz). ``mode-NN.vtu``:
    ``displacement`` as part of the largest [1], its frequency as field data ``frequency_hz``;
    ``modes.pvd`` opens them all, with the number of the mode as time. ``mode-NN-period.pvd`` with
    its ``mode-NN-frame-KK.vtu``: one period of the mode, with the part of the period as time;
    points are moved already, by 2 % of the diagonal of the stage at most, which can let bodies seem
    to run into each other. Every cell has its ``region`` and its ``body``, numbers whose names are
    in ``regions.csv``. Points are in metres.

    The mesh is that of the finite elements behind the analysis. Where not given, bodies are drawn
    as rigid ones, as the lumped model has them, and as the condensed bodies move on the whole.
    `frames` are pictures in one period of each of the `animated` lowest modes, 0 for none, else 2
    to 360; where not given, 12, but none of a mesh, whose files are large. `divisions` are parts of
    each edge of a finite element: where None its order but 4 at most in the plane, and 2 in three
    dimensions and in frames.

    Notes
    -----
    Validity: that of the model. Rigid bodies are drawn over the whole thickness, arcs by chords
    within 2 um; between two bodies a notch is drawn as a bent bar, which is only a picture, and its
    stress is that of its most stressed point. A mesh in three dimensions is written over its whole
    thickness, mirrored from the half that is meshed; stress is averaged at corners within a region,
    never over regions.

    Examples
    --------
    >>> from flexstage.stage.designs import design
    >>> from flexstage.lumped import lumped_system
    >>> from flexstage.system import analyse
    >>> stage = design("parallelogram")
    >>> files = field_files(stage, analyse(stage, lumped_system(stage)), frames=4, animated=1)
    >>> [name for name in files if "frame" in name][-1]
    'mode-01-frame-04.vtu'
    """
    if frames is None:
        frames = 12 if mesh is None else 0
    if not (frames == 0 or 2 <= frames <= _MOST_FRAMES) or animated < 0:
        raise ModelError(
            f"an animation has 0 or 2 to {_MOST_FRAMES} frames of 0 or more modes, got "
            f"{frames!r} frames of {animated!r} modes"
        )
    if mesh is None:
        still = moving = _of_bodies(stage, analysis)
    else:
        _require_analysed(mesh, analysis)
        solid = mesh.problems[0].continuum.dimension == 3
        usual = 2 if solid else min(mesh.mesh_settings.order, 4)
        still = _of_mesh(mesh, usual if divisions is None else divisions)
        # frames are many and small
        moving = _of_mesh(mesh, 2) if frames and divisions is None else still
    files = _still(analysis, still)
    if frames:
        size = _LARGEST * float(np.linalg.norm(np.ptp(moving.points, axis=0)))
        files |= _moving(analysis, moving, (frames, animated), size)
    return files


# ------------------------------------------------------------------ finite elements


def _require_analysed(mesh: "StageModel", analysis: Analysis) -> None:
    if mesh.system.order != analysis.system.order or mesh.system.model != analysis.system.model:
        raise ModelError(
            f"the mesh is of a {mesh.system.model} model with {mesh.system.order} coordinates, the "
            f"analysis of a {analysis.system.model} model with {analysis.system.order}: give the "
            "mesh that was analysed"
        )


def _of_mesh(mesh: "StageModel", divisions: int) -> _Drawn:
    from flexstage.fem.sampling import Sampler

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

    return _Drawn(
        points=rest.points,
        cells=_packed(rest.cells, rest.region, regions),
        regions=regions,
        displacement=lambda q: sampler.read(q, stress=False).displacement,
        static=static,
    )


# ------------------------------------------------------------------ rigid bodies


def _of_bodies(stage: Stage, analysis: Analysis) -> _Drawn:
    cells = body_cells(stage)
    regions = list(zip(cells.regions, cells.body.tolist(), strict=True))

    def displacement(q: Array) -> Array:
        return cells.displacement(analysis.system, q)

    def static(axis: AxisAnalysis) -> tuple[Fields, Fields]:
        stress = cells.hinge_values(axis.static.hinge_stress)
        moved = Values(values=displacement(axis.static.q), unit="m")
        return {"displacement": moved}, {"hinge_stress": Values(values=stress, unit="Pa")}

    return _Drawn(
        points=cells.points,
        cells=_packed(cells.cells, cells.region, regions),
        regions=regions,
        displacement=displacement,
        static=static,
    )


# ------------------------------------------------------------------ the files


def _still(analysis: Analysis, drawn: _Drawn) -> dict[str, bytes]:
    """Write statics and modes, with the names of the regions."""
    files: dict[str, bytes] = {}
    what = f"{analysis.system.model} model of {analysis.stage.name}"
    for name, axis in zip(file_names([a.axis for a in analysis.axes]), analysis.axes, strict=True):
        at_points, in_cells = drawn.static(axis)
        fields = ", ".join(f"{n} [{v.unit}]" for n, v in (at_points | in_cells).items())
        files[f"static-{name}.vtu"] = grid_file(
            drawn.points,
            drawn.cells.and_values(in_cells),
            at_points=at_points,
            about={"input_displacement_m": _one(axis.input_displacement, "m")},
            remark=f"{what}, axis {axis.axis} at full stroke: {fields}",
        )
    names = []
    found = analysis.modes["removed"]
    for k, frequency in enumerate(found.frequency_hz.tolist(), start=1):
        moved = _part_of_largest(drawn.displacement(found.shapes[:, k - 1]))
        names.append(f"mode-{k:02d}.vtu")
        files[names[-1]] = grid_file(
            drawn.points,
            drawn.cells,
            at_points={"displacement": Values(values=moved)},
            about={"frequency_hz": _one(frequency, "Hz"), "mode": _one(float(k))},
            remark=f"{what}, drives removed, mode {k} at {frequency:.6g} Hz: displacement as part "
            "of the largest",
        )
    if names:
        files["modes.pvd"] = collection_file(
            names, range(1, len(names) + 1), remark=f"modes of the {what}; time: number of the mode"
        )
    files["regions.csv"] = _region_table(analysis.stage, drawn.regions)
    return files


def _moving(
    analysis: Analysis, drawn: _Drawn, counts: tuple[int, int], size: float
) -> dict[str, bytes]:
    """Write one period, in some frames, of each of some modes; the largest motion is the size."""
    frames, animated = counts
    files: dict[str, bytes] = {}
    what = f"{analysis.system.model} model of {analysis.stage.name}"
    found = analysis.modes["removed"]
    for k, frequency in enumerate(found.frequency_hz[:animated].tolist(), start=1):
        moved = _part_of_largest(drawn.displacement(found.shapes[:, k - 1]))
        names, times = [], [i / frames for i in range(frames)]
        for i, time in enumerate(times, start=1):
            now = np.cos(2.0 * np.pi * time) * moved
            names.append(f"mode-{k:02d}-frame-{i:02d}.vtu")
            files[names[-1]] = grid_file(
                drawn.points + size * now,
                drawn.cells,
                at_points={"displacement": Values(values=now)},
                about={
                    "frequency_hz": _one(frequency, "Hz"),
                    "mode": _one(float(k)),
                    "exaggerated_to_m": _one(size, "m"),
                },
                remark=f"{what}, mode {k} at {frequency:.6g} Hz, {time:.4g} of a period, largest "
                f"motion drawn as {size:.4g} m",
            )
        files[f"mode-{k:02d}-period.pvd"] = collection_file(
            names,
            times,
            remark=f"{what}, drives removed: one period of mode {k} at {frequency:.6g} Hz; time: "
            "part of the period",
        )
    return files


def _packed(
    cells: NDArray[np.intp], region: NDArray[np.intp], regions: Sequence[tuple[str, int]]
) -> PackedCells:
    bodies = np.array([body for _, body in regions], dtype=np.intp)
    in_cells = {"region": Values(values=region), "body": Values(values=bodies[region])}
    return packed_cells(cells, in_cells)


def _part_of_largest(displacement: Array) -> Array:
    return displacement / (float(np.linalg.norm(displacement, axis=1).max()) or 1.0)


def _one(value: float, unit: str = "") -> Values:
    return Values(values=np.array([value]), unit=unit)


def _region_table(stage: Stage, regions: Sequence[tuple[str, int]]) -> bytes:
    """Write the names of regions and bodies."""
    rows = ((i, name, body, stage.bodies[body].name) for i, (name, body) in enumerate(regions))
    return csv_text([("region", "region name", "body", "body name"), *rows]).encode()


def export(given: StageExport) -> dict[str, bytes]:
    """Write the format."""
    return field_files(given.stage, given.analysis, mesh=given.mesh)
