"""Files of the Visualization Toolkit as text with packed numbers: grids, and lists of grids."""

import base64
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from html import escape

import numpy as np
from numpy.typing import NDArray

import flexstage
from flexstage.errors import ModelError

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
    return f"{plain}; written by flexstage {flexstage.__version__}"


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
