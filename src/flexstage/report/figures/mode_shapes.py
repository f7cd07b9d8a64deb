"""Mode shapes as small SVG pictures that a page can move."""

import html
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from flexstage.quantities import number
from flexstage.report.figures.shapes import BodyShape, body_shapes, extent
from flexstage.report.figures.style import FIXED, css_name
from flexstage.stage import Stage
from flexstage.system import Analysis, MechanicalSystem

#: Modes that are drawn for each condition of the drives.
MOST_SHOWN = 6
_MM = 1e3
# the largest motion of a mode is drawn as this part of the size of the stage
_SHOWN = 0.03


def mode_motion(
    system: MechanicalSystem, shape: NDArray[np.float64], stage: Stage
) -> dict[str, tuple[float, float, float]]:
    """Return the motion of every body in a mode, scaled so that the largest displacement is 1.

    Displacement x, y of the body's centre [1] and rotation [1/m] by body.
    """
    ports = {port.name: port for port in system.bodies}
    motion: dict[str, tuple[float, float, float]] = {}
    largest = 0.0
    for drawn in body_shapes(stage):
        port = ports.get(drawn.body.name)
        if port is None:
            continue
        ux, uy, angle = map(float, port.matrix @ shape)
        motion[port.name] = (ux, uy, angle)
        arm = np.vstack(drawn.loops) - np.array(port.centre)
        largest = max(
            largest, float(np.hypot(ux - angle * arm[:, 1], uy + angle * arm[:, 0]).max())
        )
    scale = 1.0 / largest if largest > 0.0 else 0.0
    return {name: (ux * scale, uy * scale, a * scale) for name, (ux, uy, a) in motion.items()}


def body_symbols(stage: Stage) -> str:
    """Return every body once, as SVG symbols that the cards refer to.

    The element takes no room.
    """
    paths = "".join(
        f'<path id="body-{i}" vector-effect="non-scaling-stroke" d="{shape.svg_path(_MM)}"/>'
        for i, shape in enumerate(body_shapes(stage))
    )
    return f'<svg class="symbols" aria-hidden="true"><defs>{paths}</defs></svg>'


def mode_cards(analysis: Analysis) -> Mapping[str, str]:
    """Return the lowest modes of each condition of the drives.

    A card is a still picture of the mode at full amplitude; each body carries its motion in data
    attributes (``data-motion``: displacement x and y in mm and rotation in degrees about
    ``data-centre``), by which the page moves it.
    """
    shapes = body_shapes(analysis.stage)
    cards: dict[str, str] = {}
    for condition, found in analysis.modes.items():
        count = min(MOST_SHOWN, found.frequency_hz.size)
        cards[condition] = "".join(
            _card(analysis, shapes, found.shapes[:, k], k, float(found.frequency_hz[k]), condition)
            for k in range(count)
        )
    return cards


def _card(
    analysis: Analysis,
    shapes: tuple[BodyShape, ...],
    shape: NDArray[np.float64],
    index: int,
    frequency: float,
    condition: str,
) -> str:
    x0, y0, x1, y1 = (v * _MM for v in extent(shapes))
    size = max(x1 - x0, y1 - y0)
    margin = 0.03 * size
    reach = _SHOWN * size
    motion = mode_motion(analysis.system, shape, analysis.stage)
    centres = {port.name: port.centre for port in analysis.system.bodies}
    parts = []
    for i, drawn in enumerate(shapes):
        name = drawn.body.name
        if drawn.body.fixed or name not in motion:
            parts.append(f'<use href="#body-{i}" fill="var({css_name(FIXED)})"/>')
            continue
        ux, uy, angle = motion[name]
        cx, cy = centres[name][0] * _MM, -centres[name][1] * _MM
        arm = np.vstack(drawn.loops) - np.array(centres[name])
        part = np.hypot(ux - angle * arm[:, 1], uy + angle * arm[:, 0]).mean()
        # y points down in the picture, so the sense of rotation is turned over as well
        dx, dy, turn = ux * reach, -uy * reach, -np.degrees(angle * reach / _MM)
        parts.append(
            f'<use href="#body-{i}" class="moving" fill-opacity="{0.12 + 0.78 * part:.2f}" '
            f'data-motion="{dx:.3f} {dy:.3f} {turn:.3f}" data-centre="{cx:.2f} {cy:.2f}" '
            f'transform="translate({dx:.3f} {dy:.3f}) rotate({turn:.3f} {cx:.2f} {cy:.2f})"/>'
        )
    box = f"{x0 - margin:.1f} {-y1 - margin:.1f} {x1 - x0 + 2 * margin:.1f} "
    box += f"{y1 - y0 + 2 * margin:.1f}"
    caption = f"<b>{number(frequency)} Hz</b> mode {index + 1}, drives {html.escape(condition)}"
    label = f"mode {index + 1} at {number(frequency)} Hz, drives {html.escape(condition)}"
    return (
        f'<figure class="mode"><svg viewBox="{box}" role="img" aria-label="{label}">'
        f"{''.join(parts)}</svg><p>{caption}</p></figure>"
    )
