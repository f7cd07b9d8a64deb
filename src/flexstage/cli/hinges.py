"""`flexstage hinges`: the stiffness of a notch profile by every method, and how far it may turn."""

import dataclasses
import math
from typing import TYPE_CHECKING, Any

from flexstage.cli.options import (
    JsonOption,
    PlaneOption,
    from_docstring,
    positive_length,
    quantity,
    refuse,
)
from flexstage.cli.output import console, print_json, print_table
from flexstage.errors import HingeError

if TYPE_CHECKING:
    from flexstage.hinges import Profile


@from_docstring
def hinges(
    profile: str = "circular",
    neck: str = "0.5 mm",
    width: str = "10 mm",
    material: str = "Al 7075-T6",
    radius: str | None = None,
    length: str | None = None,
    depth: str | None = None,
    half_angle: str | None = None,
    exponent: float | None = None,
    one_sided: bool = False,
    plane: PlaneOption = "auto",
    as_json: JsonOption = False,
) -> None:
    """Compute stiffness and range of a hinge by every method.

    A profile takes these sizes beside --neck: circular --radius; corner-filleted --length --radius;
    leaf, elliptical, parabolic and hyperbolic --length --depth; v --depth --half-angle --radius;
    power --length --depth --exponent. Without any of them the notch is circular, of radius 1 mm.

    Parameters
    ----------
    profile
        KIND: circular, elliptical, corner-filleted, leaf, parabolic, hyperbolic, v, power.
    neck
        LENGTH: Thickness of the neck, such as "0.5 mm".
    width
        LENGTH: Width of the hinge, such as "10 mm".
    material
        NAME: Name of a material in the catalogue.
    radius
        LENGTH: Radius of a circular notch, or of the fillets.
    length
        LENGTH: Total length of the notch.
    depth
        LENGTH: Depth of the notch on one side.
    half_angle
        ANGLE: Half opening angle of a v notch, such as "30 deg".
    exponent
        N: Exponent of a power notch.
    one_sided
        Cut the notch on one side only.
    """
    from flexstage.hinges.hinge_figures import hinge_figures
    from flexstage.material import material as find_material

    given = {
        "radius": radius,
        "length": length,
        "depth": depth,
        "half-angle": half_angle,
        "exponent": None if exponent is None else str(exponent),
    }
    if profile == "circular" and not any(given.values()):
        given["radius"] = "1 mm"
    notch = _profile(profile, neck, given, one_sided=one_sided)
    result = hinge_figures(
        notch, find_material(material), positive_length(width, "the width"), plane
    )
    if as_json:
        print_json(result)
    else:
        _print(result)


# Option that each field of a profile is read from; lengths along the hinge are given whole.
_OPTIONS = {
    "radius": "radius",
    "fillet_radius": "radius",
    "notch_length": "length",
    "leaf_length": "length",
    "half_length": "length",
    "notch_depth": "depth",
    "half_opening_angle": "half-angle",
    "exponent": "exponent",
}


def _profile(kind: str, neck: str, given: dict[str, str | None], *, one_sided: bool) -> "Profile":
    """Make the profile, and name every size that is missing or does not belong to it."""
    from flexstage.hinges.registry import profile_class

    cls = profile_class(kind)
    contour = "an as-drawn notch has a contour, which only a stage file can hold"
    refuse(kind == "as-drawn", contour, HingeError)
    fields = [f.name for f in dataclasses.fields(cls) if f.name in _OPTIONS]
    wanted = [_OPTIONS[name] for name in fields]
    list_wanted = " ".join(f"--{name}" for name in wanted)
    missing = [f"--{name}" for name in wanted if given[name] is None]
    refuse(missing, f"a {kind} notch also needs {' and '.join(missing)}", HingeError)
    surplus = [
        f"--{name}" for name, text in given.items() if text is not None and name not in wanted
    ]
    sentence = f"a {kind} notch has no {' or '.join(surplus)}: it takes {list_wanted}"
    refuse(surplus, sentence, HingeError)
    values: dict[str, Any] = {}
    for name, which in zip(fields, wanted, strict=True):
        text = given[which]
        if which == "exponent":
            values[name] = float(str(text))
        else:
            size = (
                quantity(str(text), "angle")
                if which == "half-angle"
                else positive_length(str(text), f"--{which}")
            )
            values[name] = 0.5 * size if name == "half_length" else size
    return cls(neck_thickness=positive_length(neck, "the neck"), one_sided=one_sided, **values)


def _print(result: dict[str, Any]) -> None:
    """Print the tables for people."""
    from flexstage.quantities import number
    from flexstage.table import Cell

    sizes = {
        name.replace("_", " "): f"{1e3 * value:g} mm"
        for name, value in result.items()
        if name.endswith(("thickness", "radius", "length", "depth", "width", "height"))
    }
    if "half_opening_angle" in result:
        sizes["half opening angle"] = f"{math.degrees(result['half_opening_angle']):g} deg"
    if "exponent" in result:
        sizes["exponent"] = f"{result['exponent']:g}"
    cut = "one side" if result["one_sided"] else "both sides"
    out = console()
    out.print(
        f"{result['profile']} notch cut from {cut}, {result['material']}, plane {result['plane']}: "
        + ", ".join(f"{name} {text}" for name, text in sizes.items()),
        markup=False,
    )
    rows = []
    last = ""
    for row in result["stiffness"]:
        value, difference = row["stiffness"], row["difference_percent"]
        in_um = row["unit"] == "N/m"
        against = "-" if difference is None else f"{difference:+.2f} %"
        rows.append(
            (
                row["quantity"] if row["quantity"] != last else "",
                row["method"],
                Cell(
                    "–" if value is None else number(value * (1e-6 if in_um else 1.0), 5),
                    note=row["validity"],
                ),
                "N/um" if in_um else row["unit"],
                "" if row["method"] == "wedge" else against,
            )
        )
        last = row["quantity"]
    heads = "quantity", "<method", "stiffness", "<unit", "to wedge"
    print_table(out, "Stiffness about the neck", heads, rows)
    factors = result["concentration"]
    print_table(
        out,
        "Stress concentration at the neck",
        ("load", "left surface", "right surface"),
        ((load, *(f"{v:.4f}" for v in factors[load])) for load in ("axial", "bending")),
    )
    out.print(f"source: {factors['source']}", markup=False)
    out.print(f"valid: {factors['validity']}\n", markup=False)
    turn = result["largest_rotation"]
    cycles = turn["fatigue_cycles"]
    fatigue = "fatigue limit" + (f" ({cycles:.0e} cycles)" if cycles else "")
    print_table(
        out,
        "Largest rotation under a pure moment",
        ("before", "mrad", "deg"),
        (
            (name, "-", "-")
            if value is None
            else (name, f"{1e3 * value:.2f}", f"{math.degrees(value):.3f}")
            for name, value in (("yield", turn["before_yield"]), (fatigue, turn["before_fatigue"]))
        ),
    )
