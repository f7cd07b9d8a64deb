"""Statics and modes of any model as files for ParaView and its like, with modes that move."""

import csv
import io
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from flexstage.arrays import Array
from flexstage.errors import ModelError
from flexstage.export.body_cells import BodyCells, body_cells
from flexstage.export.file_names import file_names
from flexstage.fem.vtk_format import PackedCells, Values, collection_file, grid_file, packed_cells
from flexstage.stage import Stage
from flexstage.system import Analysis, DriveCondition

if TYPE_CHECKING:
    from flexstage.fem import StageModel

_MOST_FRAMES = 360


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Shape:
    """Cells of a model at rest, and their displacement for a state of the system."""

    points: Array
    cells: PackedCells
    displacement: Callable[[Array], Array]


def field_files(
    stage: Stage,
    analysis: Analysis,
    *,
    mesh: "StageModel | None" = None,
    drives: DriveCondition = "removed",
    frames: int | None = None,
    animated: int = 6,
    largest: float = 0.02,
    divisions: int | None = None,
) -> dict[str, bytes]:
    """Return statics and modes of a model as files of the Visualization Toolkit.

    ``static-AXIS.vtu``: each axis at full stroke, with ``displacement`` [m] and, of rigid bodies,
    ``hinge_stress`` [Pa], the largest of each hinge in all cells of its notch. ``mode-NN.vtu``:
    ``displacement`` as part of the largest [1], its frequency as field data ``frequency_hz``;
    ``modes.pvd`` opens them all, with the number of the mode as time. ``mode-NN-period.pvd`` with
    its ``mode-NN-frame-KK.vtu``: one period of the mode, with the part of the period as time;
    points are moved already, by `largest` at most, which can let bodies seem to run into each
    other. Every cell has its ``region`` and its ``body``, numbers whose names stand in
    ``regions.csv``. Points are in metres.

    The mesh is that of the finite elements behind the analysis. Where not given, bodies are drawn
    as rigid ones, as the lumped model has them, and as the condensed bodies move on the whole.
    `frames` are pictures in one period of each of the `animated` lowest modes, 0 for none, else 2
    to 360; where not given, 12, but none of a mesh, whose files are large. `largest` is the largest
    motion that is drawn, as part of the diagonal of the stage [1]; `divisions` are parts of each
    edge of a finite element, as in `flexstage.fem.vtu.vtu_files`.

    Notes
    -----
    Validity: that of the model. Rigid bodies are drawn over the whole thickness, arcs by chords
    within 2 um; between two bodies a notch is drawn as a bent bar, which is only a picture, and its
    stress is that of its most stressed point.

    Examples
    --------
    >>> from flexstage.designs import design
    >>> from flexstage.lumped import lumped_system
    >>> from flexstage.system import analyse
    >>> stage = design("parallelogram")
    >>> files = field_files(stage, analyse(stage, lumped_system(stage)), frames=4, animated=1)
    >>> [name for name in files if "frame" in name][-1]
    'mode-01-frame-04.vtu'
    """
    if drives not in analysis.modes:
        raise ModelError(
            f"the analysis has no modes with drives {drives}: choose from "
            f"{', '.join(analysis.modes)}"
        )
    if frames is None:
        frames = 12 if mesh is None else 0
    if not 0.0 < largest <= 1.0:
        raise ModelError(
            "the largest motion drawn is above 0 and at most 1 diagonal of the stage, got "
            f"{largest!r}"
        )
    if not (frames == 0 or 2 <= frames <= _MOST_FRAMES) or animated < 0:
        raise ModelError(
            f"an animation has 0 or 2 to {_MOST_FRAMES} frames of 0 or more modes, got "
            f"{frames!r} frames of {animated!r} modes"
        )
    if mesh is None:
        cells = body_cells(stage)
        shape = _of_bodies(cells, analysis)
        files = _still(analysis, drives, cells, shape)
    else:
        files, shape = _of_mesh(mesh, analysis, drives, divisions, moving=frames > 0)
    if frames and shape is not None:
        size = largest * float(np.linalg.norm(np.ptp(shape.points, axis=0)))
        files |= _moving(analysis, drives, shape, (frames, animated), size)
    return files


# ------------------------------------------------------------------ finite elements


def _of_mesh(
    mesh: "StageModel",
    analysis: Analysis,
    drives: DriveCondition,
    divisions: int | None,
    *,
    moving: bool,
) -> tuple[dict[str, bytes], _Shape | None]:
    from flexstage.fem.sampling import Sampler
    from flexstage.fem.vtu import vtu_files

    if mesh.system.order != analysis.system.order or mesh.system.model != analysis.system.model:
        raise ModelError(
            f"the mesh is of a {mesh.system.model} model with {mesh.system.order} coordinates, the "
            f"analysis of a {analysis.system.model} model with {analysis.system.order}: give the "
            "mesh that was analysed"
        )
    files = vtu_files(mesh, analysis, divisions=divisions, drives=drives)
    if not moving:
        return files, None
    # frames are many and small: the corners of the elements, or two parts of an edge
    sampler = Sampler(model=mesh, divisions=divisions or 2, extent="whole", seams=True)
    rest = sampler.read(np.zeros(mesh.system.order), stress=False)
    bodies = np.array([sampler.bodies[name] for name in sampler.regions], dtype=np.intp)
    return files, _Shape(
        points=rest.points,
        cells=_packed(rest.cells, rest.region, bodies),
        displacement=lambda q: sampler.read(q, stress=False).displacement,
    )


# ------------------------------------------------------------------ rigid bodies


def _of_bodies(cells: BodyCells, analysis: Analysis) -> _Shape:
    return _Shape(
        points=cells.points,
        cells=_packed(cells.cells, cells.region, cells.body),
        displacement=lambda q: cells.displacement(analysis.system, q),
    )


def _still(
    analysis: Analysis, drives: DriveCondition, cells: BodyCells, shape: _Shape
) -> dict[str, bytes]:
    """Write statics and modes of rigid bodies, with the names of their regions."""
    files: dict[str, bytes] = {}
    what = f"{analysis.system.model} model of {analysis.stage.name}"
    for name, axis in zip(file_names([a.axis for a in analysis.axes]), analysis.axes, strict=True):
        moved = shape.displacement(axis.static.q)
        stress = cells.hinge_values(axis.static.hinge_stress)
        files[f"static-{name}.vtu"] = grid_file(
            shape.points,
            shape.cells.and_values({"hinge_stress": Values(values=stress, unit="Pa")}),
            at_points={"displacement": Values(values=moved, unit="m")},
            about={"input_displacement_m": _one(axis.input_displacement, "m")},
            remark=f"{what}, axis {axis.axis} at full stroke: displacement [m], hinge_stress [Pa]",
        )
    names = []
    found = analysis.modes[drives]
    for k, frequency in enumerate(found.frequency_hz.tolist(), start=1):
        moved = _part_of_largest(shape.displacement(found.shapes[:, k - 1]))
        names.append(f"mode-{k:02d}.vtu")
        files[names[-1]] = grid_file(
            shape.points,
            shape.cells,
            at_points={"displacement": Values(values=moved)},
            about={"frequency_hz": _one(frequency, "Hz"), "mode": _one(float(k))},
            remark=f"{what}, drives {drives}, mode {k} at {frequency:.6g} Hz: displacement as part "
            "of the largest",
        )
    if names:
        files["modes.pvd"] = collection_file(
            names, range(1, len(names) + 1), remark=f"modes of the {what}; time: number of the mode"
        )
    files["regions.csv"] = _regions(cells)
    return files


def _moving(
    analysis: Analysis, drives: DriveCondition, shape: _Shape, counts: tuple[int, int], size: float
) -> dict[str, bytes]:
    """Write one period, in some frames, of each of some modes; the largest motion is the size."""
    frames, animated = counts
    files: dict[str, bytes] = {}
    what = f"{analysis.system.model} model of {analysis.stage.name}"
    found = analysis.modes[drives]
    for k, frequency in enumerate(found.frequency_hz[:animated].tolist(), start=1):
        moved = _part_of_largest(shape.displacement(found.shapes[:, k - 1]))
        names, times = [], [i / frames for i in range(frames)]
        for i, time in enumerate(times, start=1):
            now = np.cos(2.0 * np.pi * time) * moved
            names.append(f"mode-{k:02d}-frame-{i:02d}.vtu")
            files[names[-1]] = grid_file(
                shape.points + size * now,
                shape.cells,
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
            remark=f"{what}, drives {drives}: one period of mode {k} at {frequency:.6g} Hz; time: "
            "part of the period",
        )
    return files


def _packed(
    cells: NDArray[np.intp], region: NDArray[np.intp], bodies: NDArray[np.intp]
) -> PackedCells:
    in_cells = {"region": Values(values=region), "body": Values(values=bodies[region])}
    return packed_cells(cells, in_cells)


def _part_of_largest(displacement: Array) -> Array:
    return displacement / (float(np.linalg.norm(displacement, axis=1).max()) or 1.0)


def _one(value: float, unit: str = "") -> Values:
    return Values(values=np.array([value]), unit=unit)


def _regions(cells: BodyCells) -> bytes:
    """Write the names of regions and bodies."""
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(("region", "region name", "body", "body name"))
    for i, (name, body) in enumerate(zip(cells.regions, cells.body.tolist(), strict=True)):
        table.writerow((i, name, body, cells.stage.bodies[body].name))
    return text.getvalue().encode()
