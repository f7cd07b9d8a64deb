"""Finite-element results as files of the Visualization Toolkit, for ParaView and its like.

Points are in metres, as displacements are, so that a shape warped by a factor is exaggerated by it.
"""

import csv
import io
import re
from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from flexstage.errors import ModelError
from flexstage.fem.model import StageModel
from flexstage.fem.sampling import Sample, Sampler
from flexstage.fem.vtk_format import CELL_TYPES, GRID, HEAD, Values, data_array
from flexstage.system import Analysis, DriveCondition

# of a symmetric tensor the format has xx, yy, zz, xy, yz, xz; ours is xx, yy, zz, yz, xz, xy
_ORDER = [0, 1, 2, 5, 3, 4]
_NAMES = ("XX", "YY", "ZZ", "XY", "YZ", "XZ")


def vtu_files(
    model: StageModel,
    analysis: Analysis,
    *,
    divisions: int | None = None,
    drives: DriveCondition = "removed",
) -> dict[str, bytes]:
    """Return statics and modes of a finite-element model as files.

    By name. ``static-AXIS.vtu`` for each axis at full stroke: ``displacement`` [m], ``von_mises``
    [Pa] and ``stress`` [Pa] (xx, yy, zz, xy, yz, xz). ``mode-NN.vtu``: ``displacement`` as a part
    of the largest [1], with the frequency [Hz] as field data; ``modes.pvd`` opens all modes, the
    number of each as its time. Every cell has its ``region`` and its ``body``, numbers whose names
    stand in ``regions.csv``.

    `divisions` are parts of each edge of an element: where None its order but 4 at most in the
    plane, and 2 in three dimensions. `drives` is their condition for the modes.

    Notes
    -----
    Validity: a model in three dimensions is written over its whole thickness, mirrored from the
    half that is meshed. Stress is averaged at corners within a region, never over regions.
    """
    if drives not in analysis.modes:
        raise ModelError(
            f"the analysis has no modes with drives {drives}: choose from "
            f"{', '.join(analysis.modes)}"
        )
    if divisions is None:
        solid = model.problems[0].continuum.dimension == 3
        divisions = 2 if solid else min(model.mesh_settings.order, 4)
    sampler = Sampler(model=model, divisions=divisions, extent="whole", seams=True)
    files = {}
    for name, axis in zip(_file_names([a.axis for a in analysis.axes]), analysis.axes, strict=True):
        sample = sampler.read(axis.static.q)
        assert sample.stress is not None
        fields = {
            "displacement": sample.displacement,
            "von_mises": sample.von_mises,
            "stress": sample.stress[:, _ORDER],
        }
        about = {"input_displacement_m": axis.input_displacement}
        files[f"static-{name}.vtu"] = _grid(sampler, sample, fields, about)
    found = analysis.modes[drives]
    modes = []
    for k, frequency in enumerate(found.frequency_hz):
        sample = sampler.read(found.shapes[:, k], stress=False)
        largest = float(sample.magnitude.max())
        fields = {"displacement": sample.displacement / (largest or 1.0)}
        about = {"frequency_hz": float(frequency), "mode": float(k + 1)}
        modes.append(f"mode-{k + 1:02d}.vtu")
        files[modes[-1]] = _grid(sampler, sample, fields, about)
    if modes:
        files["modes.pvd"] = _collection(modes)
    files["regions.csv"] = _regions(sampler)
    return files


def _file_names(names: Iterable[str]) -> list[str]:
    """Names without what a file system minds, each once."""
    found: list[str] = []
    for name in names:
        plain = re.sub(r"[^\w+-]+", "_", name) or "_"
        count = 2
        free = plain
        while free.lower() in {f.lower() for f in found}:
            free, count = f"{plain}-{count}", count + 1
        found.append(free)
    return found


# ------------------------------------------------------------------ the format


def _grid(
    sampler: Sampler,
    sample: Sample,
    fields: Mapping[str, NDArray[np.float64]],
    about: Mapping[str, float],
) -> bytes:
    """Write an unstructured grid; `about` goes into its field data."""
    count, corners = sample.cells.shape
    bodies = np.array([sampler.bodies[name] for name in sampler.regions], dtype=np.int64)
    general = [_array(name, np.array([value])) for name, value in about.items()]
    cells = [
        _array("connectivity", sample.cells.ravel()),
        _array("offsets", corners * np.arange(1, count + 1)),
        _array("types", np.full(count, CELL_TYPES[corners], dtype=np.uint8)),
    ]
    parts = [
        GRID,
        "<UnstructuredGrid>",
        f"<FieldData>{''.join(general)}</FieldData>",
        f'<Piece NumberOfPoints="{sample.points.shape[0]}" NumberOfCells="{count}">',
        f"<Points>{_array('points', sample.points)}</Points>",
        f"<Cells>{''.join(cells)}</Cells>",
        f"<PointData>{''.join(_array(n, v) for n, v in fields.items())}</PointData>",
        f"<CellData>{_array('region', sample.region)}{_array('body', bodies[sample.region])}"
        "</CellData>",
        "</Piece></UnstructuredGrid></VTKFile>\n",
    ]
    return (HEAD + "\n".join(parts)).encode()


def _array(name: str, values: NDArray) -> str:
    """Write numbers; those of a symmetric tensor have names."""
    components = _NAMES if values.ndim == 2 and values.shape[1] == 6 else ()
    return data_array(name, Values(values=values, components=components))


def _regions(sampler: Sampler) -> bytes:
    """Write the names of regions and bodies."""
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(("region", "region name", "body", "body name"))
    for i, name in enumerate(sampler.regions):
        body = sampler.bodies[name]
        table.writerow((i, name, body, sampler.model.stage.bodies[body].name))
    return text.getvalue().encode()


def _collection(files: Sequence[str]) -> bytes:
    sets = "".join(
        f'<DataSet timestep="{k}" group="" part="0" file="{name}"/>\n'
        for k, name in enumerate(files, start=1)
    )
    text = (
        f'{HEAD}<VTKFile type="Collection" version="1.0" byte_order="LittleEndian">\n'
        f"<Collection>\n{sets}</Collection></VTKFile>\n"
    )
    return text.encode()
