"""The diagrams of a stage as files."""

from flexstage.export.diagram.stage_diagram import stage_diagram
from flexstage.export.diagram.svg import diagram_svg
from flexstage.export.file_names import file_names
from flexstage.export.model import DynamicModel
from flexstage.stage import Stage
from flexstage.system import RayleighDamping


def diagram_files(
    stage: Stage,
    *,
    model: DynamicModel | None = None,
    damping: RayleighDamping | None = None,
) -> dict[str, bytes]:
    """Draw a stage and each of its axes.

    ``diagram.svg`` and, for each axis, ``diagram-AXIS.svg``. Where no model is given, amplifiers,
    hysteresis, creep and sensors are those of `flexstage.export.dynamic_model`; damping is fitted
    to the two lowest modes where none is given.

    Examples
    --------
    >>> from flexstage.designs import design
    >>> sorted(diagram_files(design("parallelogram")))
    ['diagram-x.svg', 'diagram.svg']
    """
    out = {"diagram.svg": diagram_svg(stage_diagram(stage, model=model, damping=damping))}
    safe = file_names(axis.name for axis in stage.axes)
    for axis, name in zip(stage.axes, safe, strict=True):
        made = stage_diagram(stage, model=model, axis=axis.name, damping=damping)
        out[f"diagram-{name}.svg"] = diagram_svg(made)
    return out
