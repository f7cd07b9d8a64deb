"""The lowest mode shapes of a finite-element model, filled with how far each point moves."""

import math
from typing import TYPE_CHECKING

import numpy as np

from flexstage.arrays import Array
from flexstage.quantities import number
from flexstage.report.figures.fields import Bands, add_bar, fill, frame, place, trace, window
from flexstage.report.figures.style import MUTED, dress, entitle, new_figure
from flexstage.system import Analysis, DriveCondition

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from flexstage.fem import StageModel
    from flexstage.fem.sampling import Sample

_MOST = 6
_COLUMNS = 3
_WIDTH = 3.3  # of a picture [inch]
# the largest motion of a mode is drawn as this part of the size of the stage
_SHOWN = 0.03
_MARGIN = 0.05
_SIZE, _LIFT = "displacement / largest [1]", "displacement out of plane / largest [1]"
_IN_PLANE, _OUT_OF_PLANE = "viridis", "RdBu_r"


def out_of_plane(model: "StageModel", q: Array) -> bool:
    """Tell whether more than half of a mode's kinetic energy is motion out of the plane.

    `q` are the coordinates of the model, shape (r,).
    """
    # the coordinates of the two problems do not mix, and have unit mass
    energy = [float((q[problem.basis.any(axis=0)] ** 2).sum()) for problem in model.problems]
    out = sum(e for e, problem in zip(energy, model.problems, strict=True) if problem.out_of_plane)
    return out > 0.5 * sum(energy)


def draw_fe_modes(
    model: "StageModel",
    analysis: Analysis,
    *,
    drives: DriveCondition = "removed",
    most: int = _MOST,
) -> "Figure":
    """Draw the lowest modes of a finite-element model.

    On the deformed shape the magnitude of the displacement as a part of the largest; of a mode out
    of the plane the displacement out of it, with its sign, on the middle plane, which such a mode
    leaves as it is. A thin line shows the stage at rest.
    """
    from flexstage.fem.sampling import Sampler

    found = analysis.modes[drives]
    count = min(most, found.frequency_hz.size)
    sampler = Sampler(model=model, divisions=4)
    bands = Bands(0.0, 1.0, _IN_PLANE, count=20)
    signed = Bands(-1.0, 1.0, _OUT_OF_PLANE, count=20)
    shapes = [found.shapes[:, k] for k in range(count)]
    lifted = [out_of_plane(model, shape) for shape in shapes]

    at_rest = sampler.read(shapes[0], stress=False).points[:, :2]
    x0, y0, x1, y1 = window(at_rest, _MARGIN)
    scales = [(bands, _SIZE)] if not all(lifted) else []
    scales += [(signed, _LIFT)] if any(lifted) else []
    figure, grid, bars = _arranged((y1 - y0) / (x1 - x0), count, len(scales))
    for k, axes in enumerate(grid):
        sample = sampler.read(shapes[k], stress=False)
        points, values = _drawn(sample, lifted=lifted[k])
        dress(axes, grid=False)
        frame(axes, (x0, y0, x1, y1), ticks=False)
        fill(
            axes, points, sample.cells, values, sampler.outline, signed if lifted[k] else bands
        )  # fmt: skip
        if not lifted[k]:
            trace(axes, at_rest, sampler.outline, linewidths=0.3, colors=MUTED)
        trace(axes, points, sampler.outline, linewidths=0.35)
        where = " · out of plane" if lifted[k] else ""
        entitle(
            axes,
            f"mode {k + 1} · {number(float(found.frequency_hz[k]))} Hz · drives {drives}{where}",
            8.0,
        )
    for axes, (colours, label) in zip(bars, scales, strict=True):
        add_bar(axes, colours, label)
    return figure


def _arranged(aspect: float, count: int, bars: int) -> "tuple[Figure, list[Axes], list[Axes]]":
    """Lay out pictures of this height to width, and colour bars beside them."""
    title, gap, beside = 0.32, 0.15, 0.85
    columns, rows = min(_COLUMNS, count), math.ceil(count / _COLUMNS)
    width = min(_WIDTH, 1.3 * _WIDTH / aspect)
    height = width * aspect
    cell = max(width, 2.4) + gap  # as wide as its title at least
    high = rows * (height + title) + 0.1
    across = columns * cell
    figure = new_figure(across + bars * beside + 0.05, max(high, 1.6))
    figure.set_layout_engine("none")
    grid = [
        place(
            figure,
            0.05 + (k % columns) * cell,
            title + (k // columns) * (height + title),
            width,
            height,
        )
        for k in range(count)
    ]
    tall = min(0.8 * max(high, 1.6), 4.5)
    top = 0.5 * (max(high, 1.6) - tall)
    scales = [place(figure, across + 0.1 + i * beside, top, 0.14, tall) for i in range(bars)]
    return figure, grid, scales


def _drawn(sample: "Sample", *, lifted: bool) -> tuple[Array, Array]:
    """Return the corners of a mode as they are drawn, and what colours them."""
    points, motion = sample.points[:, :2], sample.displacement
    size = float((points.max(axis=0) - points.min(axis=0)).max())
    if lifted:
        values = motion[:, 2] / (np.abs(motion[:, 2]).max() or 1.0)
        # which way a mode starts says nothing: upwards where it moves furthest
        return points, values * np.sign(values[np.argmax(np.abs(values))])
    largest = float(sample.magnitude.max()) or 1.0
    return points + _SHOWN * size / largest * motion[:, :2], sample.magnitude / largest
