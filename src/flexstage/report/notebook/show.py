"""Reading and drawing of stages, notches, and the text of results, at a prompt."""

import os
import typing
from collections.abc import Mapping
from dataclasses import MISSING, dataclass, fields
from typing import TYPE_CHECKING, Any

from flexstage.base.errors import HingeError
from flexstage.hinges.hinge_figures import HingeFigures
from flexstage.hinges.registry import profile_class
from flexstage.quantities.characteristic import Characteristics
from flexstage.quantities.material import Material
from flexstage.quantities.material import material as find_material
from flexstage.quantities.quantity import display, number
from flexstage.quantities.table import table
from flexstage.quantities.units import Dimension, parse
from flexstage.report.page import table_html
from flexstage.stage import Stage
from flexstage.stage.designs import find_stage

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def read(source: str | os.PathLike[str], set: Mapping[str, object] | None = None) -> Stage:
    """Return the stage of a stage file, or a built-in design by its name.

    `set` replaces parameters, see `flexstage.stage.designs.find_stage`. A notebook shows the stage
    as a drawing. `read_record` reads measured data.

    Examples
    --------
    >>> import flexstage as fs
    >>> len(fs.read("vgtu-piezo").hinges)
    32
    >>> fs.read("vgtu-piezo", set={"x.lever_neck": "0.5 mm"}).name
    'vgtu-piezo-variation'
    """
    return find_stage(source, set)


def draw(stage: Stage | str | os.PathLike[str]) -> "Figure":
    """Draw a stage, or its source as for `read`, to scale, in millimetres."""
    from flexstage.report.figures.drawing import draw_stage

    return draw_stage(stage_of(stage))


def stage_of(source: Stage | str | os.PathLike[str]) -> Stage:
    """Return a stage, read from its source if need be."""
    return source if isinstance(source, Stage) else find_stage(source)


def _drawing(stage: Stage) -> str:
    from flexstage.report.figures.style import svg_text

    return svg_text(draw(stage))


# the class of a stage has no drawing; this room adds it for notebooks
Stage._notebook_html = _drawing

#: Quantities in the text of a result.
_HEADLINE = (
    "output_displacement", "transmission_ratio", "max_stress", "natural_frequency_hz",
    "natural_frequency_with_stack_hz",
)  # fmt: skip


def headline(figures: Characteristics) -> list[str]:
    """Return the main figures of a result."""
    lines = []
    for quantity in _HEADLINE:
        rows = figures.select(quantity)
        unit = display(quantity)
        texts = [f"{row.axis} {unit.text(row.value)}" for row in rows]
        if texts:
            lines.append(f"  {unit.label.lower()}: {', '.join(texts)} {unit.shown_unit}".rstrip())
    return lines


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class HingeResult(HingeFigures):
    """Results of every method for a notch, for a notebook."""

    def _repr_html_(self) -> str:
        rows = [
            [r["quantity"], r["method"], number(r["stiffness"]), r["unit"], r["validity"]]
            for r in self.figures["stiffness"]
            if r["stiffness"] is not None
        ]
        head = ["stiffness", "<method", "", "<", "<valid"]
        return table_html(table(repr(self).splitlines()[0], head, rows))


def hinge(
    kind: str = "circular",
    *,
    width: float | str = "10 mm",
    material: Material | str = "Al 7075-T6",
    plane: str = "auto",
    **sizes: float | str | bool,
) -> HingeResult:
    """Return stiffness, stress concentration and range of a notch.

    Parameters
    ----------
    kind : str
        Kind of the profile, such as ``circular``, ``leaf`` or ``corner-filleted``.
    width : float or str
        Width of the hinge, the thickness of the plate [m], or a text with a unit.
    material : Material or str
        The material, or its name in the catalogue.
    plane : str
        ``stress``, ``strain``, or ``auto`` to choose by width against neck.
    **sizes : float or str or bool
        The fields of the profile as in a stage file, ``neck_thickness`` and ``radius`` of a
        circular one: SI numbers, or texts with a unit.

    Returns
    -------
    HingeResult
        The result.

    Raises
    ------
    HingeError
        There is no such kind, or a size is missing, unknown or invalid.
    UnitError
        A text is no quantity.

    Examples
    --------
    >>> import flexstage as fs
    >>> notch = fs.hinge("circular", neck_thickness="0.35 mm", radius="1 mm", width="10 mm")
    >>> print(f"{notch.stiffness():.3f} N m/rad")
    3.843 N m/rad
    """
    cls = profile_class(kind)
    hints = typing.get_type_hints(cls, include_extras=True)
    names = [field.name for field in fields(cls)]
    missing = [field.name for field in fields(cls) if field.default is MISSING]
    missing = [name for name in missing if name not in sizes]
    unknown = [name for name in sizes if name not in names]
    if missing or unknown:
        fault = f"has no {unknown[0]}" if unknown else f"also needs {' and '.join(missing)}"
        raise HingeError(f"a {kind} notch {fault}: it takes {', '.join(names)}")
    profile = cls(**{name: _si(value, hints[name]) for name, value in sizes.items()})
    cut_from = find_material(material) if isinstance(material, str) else material
    hinge_width = parse(width, "length", bare_unit="m")
    return HingeResult(profile=profile, material=cut_from, width=hinge_width, plane=plane)


def _si(value: float | str | bool, hint: Any) -> Any:
    """Return a size as an SI number, by the dimension of the field of the profile."""
    dimension = next((e for e in typing.get_args(hint) if isinstance(e, Dimension)), None)
    if dimension is None or isinstance(value, bool):
        return value
    return parse(value, dimension.name, bare_unit=dimension.si)
