"""Origin of each figure of a simulated measurement: published, model, scatter or assumed."""

from collections.abc import Mapping

from flexstage.quantities.characteristic import Characteristics
from flexstage.stage import PiezoStack, Stage
from flexstage.stage.assumptions import (
    DIRECTION_SPREAD,
    GUIDE_LENGTH,
    LOOP_WIDTH,
    REPEATABILITY,
    REVERSAL,
    STRAIGHTNESS,
    VIRTUAL_DAMPING_RATIO,
)

#: Figures that a simulated stage is set to where they are published.
_SET = frozenset(
    (
        "output_displacement",
        "natural_frequency_hz",
        "straightness",
        "straightness_out_of_plane",
        "linearity",
        "hysteresis_loop_width",
    )
)


def figure_origins(
    stage: Stage, published: Characteristics, paths: Mapping[str, str]
) -> dict[str, str]:
    """Return the origin of each figure, by quantity and axis, such as ``straightness x``.

    The text begins with ``published``, ``model``, ``scatter`` or ``assumed``; `paths` gives the
    model of the path of each axis that has one.
    """
    origins: dict[str, str] = {}
    for axis in stage.axes:
        piezo = isinstance(stage.drive_of(axis.name), PiezoStack)
        figures = _of_axis(paths.get(axis.name), piezo=piezo)
        known = {row.quantity for row in published if row.axis == axis.name} & _SET
        # the loop of a stack gives its linearity
        figures |= dict.fromkeys(known - ({"linearity"} if piezo else set()), "published")
        origins |= {f"{quantity} {axis.name}": text for quantity, text in figures.items()}
    if len(stage.axes) == 2:
        names = [axis.name for axis in stage.axes]
        for joint, of in (
            ("workspace_area", "output_displacement"),
            ("squareness", "cross_coupling"),
        ):
            of_each = dict.fromkeys(origins[f"{of} {name}"] for name in names)
            origins[f"{joint} {''.join(names)}"] = "; ".join(of_each)
    return origins


def _of_axis(path: str | None, *, piezo: bool) -> dict[str, str]:
    """Return the origins for an axis without published figures."""
    bow = f"assumed: {100.0 * STRAIGHTNESS:g} % of the stroke"
    turn = f"assumed: straightness over {1e3 * GUIDE_LENGTH:g} mm"
    sensor, lumped = "assumed: sensors of the laboratory", "model: lumped, with scatter"
    figures = {
        "output_displacement": lumped,
        "natural_frequency_hz": lumped,
        "damping_ratio": f"assumed: {100.0 * VIRTUAL_DAMPING_RATIO:g} %",
        "repeatability": f"assumed: {100.0 * REPEATABILITY:g} % of the stroke",
        "resolution": sensor if piezo else "assumed: smallest step of the drive, as described",
        "noise": sensor,
        "drift": sensor,
        "linearity": "assumed: loop of the stack" if piezo else bow,
        "hysteresis_loop_width": f"assumed: {100.0 * (LOOP_WIDTH if piezo else REVERSAL):g} % of "
        "the stroke",
        "straightness": bow,
        "straightness_out_of_plane": bow,
        "cross_coupling": f"assumed: within {1e3 * DIRECTION_SPREAD:g} mrad of the lumped model",
        "parasitic_rotation": turn,
        "roll": turn,
        "pitch": turn,
    }
    if path is not None:
        in_plane = ("output_displacement", "straightness", "cross_coupling", "parasitic_rotation")
        figures |= dict.fromkeys(in_plane, f"model: {path}, over the stroke, with scatter")
        lean = "scatter: lean of notches, lines of drives"
        figures |= {"roll": lean, "pitch": lean}
    return figures
