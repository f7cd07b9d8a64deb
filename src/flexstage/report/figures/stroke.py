"""Motion of an axis over its whole stroke, with finite rotations."""

from typing import TYPE_CHECKING

import numpy as np

from flexstage.errors import ModelError
from flexstage.lumped.large_displacement import StrokePath
from flexstage.quantities import number
from flexstage.report.figures.style import CYCLE, INK, dress, new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# metres and radians below this are rounding of the solution
_NOTHING = 1e-13


def draw_stroke(path: StrokePath, axis: str) -> "Figure":
    """Draw how far an axis is from the straight line of its first-order model.

    Deviation along the axis, across it, and rotation, over the elongation of the drive.
    """
    if path.displacement.size < 3:
        raise ModelError("a path needs at least three states to be drawn")
    x = path.displacement
    # the slope at the start of the stroke, from a parabola through the first three states
    slope = np.polyfit(x[:3], path.along[:3], 2)[1]
    along = path.along - path.along[0] - slope * (x - x[0])
    curves = [
        ("along, less first order", along, "m"),
        ("across, off the best line", path.deviation, "m"),
        ("rotation", path.rotation - path.rotation[0], "rad"),
    ]
    shown = [c for c in curves if np.abs(c[1]).max() > _NOTHING] or curves[:1]
    figure = new_figure((5.1, 10.2, 10.2)[len(shown) - 1], 2.9)
    for axes, (label, values, unit) in zip(figure.subplots(1, len(shown), squeeze=False)[0], shown,
                                           strict=True):  # fmt: skip
        dress(axes)
        factor, prefix = _scale(float(np.abs(values).max()))
        axes.plot(1e6 * x, factor * values, color=CYCLE[0], linewidth=1.4)
        axes.set_xlim(1e6 * x[0], 1e6 * x[-1])
        axes.set_xlabel(f"drive '{path.drive}' [µm]", fontsize=8.5, parse_math=False)
        axes.set_ylabel(f"{label} [{prefix}{unit}]", fontsize=8.5)
    figure.suptitle(
        f"{axis}: {_quantity(path.along[-1] - path.along[0], 'm')} at full stroke; "
        f"straightness {_quantity(path.straightness, 'm')}, "
        f"rotation {_quantity(path.parasitic_rotation, 'rad')}",
        x=0.01, ha="left", fontsize=9, color=INK, parse_math=False,
    )  # fmt: skip
    return figure


def _scale(largest: float) -> tuple[float, str]:
    for factor, prefix in ((1e6, "µ"), (1e9, "n")):
        if largest * factor >= 0.1:
            return factor, prefix
    return 1e12, "p"


def _quantity(value: float, unit: str) -> str:
    if abs(value) < _NOTHING:
        return "0"
    factor, prefix = _scale(abs(value))
    return f"{number(factor * value)} {prefix}{unit}"
