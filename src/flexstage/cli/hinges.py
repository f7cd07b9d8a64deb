"""`flexstage hinges`: stiffness of a notch profile by every method, and its largest rotation."""

import math
from typing import Any

from flexstage.cli.options import JsonOption, from_docstring
from flexstage.cli.output import console, print_json, print_table
from flexstage.hinges.requests import HingesRequest


@from_docstring
def hinges(
    *,
    request: HingesRequest,
    as_json: JsonOption = False,
) -> None:
    """Compute stiffness and range of a hinge by every method.

    Each profile has --neck and these sizes: circular --radius; corner-filleted --length --radius;
    leaf, elliptical, parabolic and hyperbolic --length --depth; v --depth --half-angle --radius;
    power --length --depth --exponent. Without sizes the notch is circular, of radius 1 mm.
    """
    from flexstage.hinges.hinge_figures import notch_of

    result = notch_of(request).to_dict()
    if as_json:
        print_json(result)
    else:
        _print(result)


def _print(result: dict[str, Any]) -> None:
    """Print the tables for people."""
    from flexstage.quantities.quantity import number
    from flexstage.quantities.table import Cell

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
    heads = "quantity", "<method", "stiffness", "<unit", "difference to wedge"
    print_table(out, "Stiffness about the neck", heads, rows)
    factors = result["concentration"]
    print_table(
        out,
        "Stress concentration at the neck",
        ("load", "left surface", "right surface"),
        ((load, *(f"{v:.4f}" for v in factors[load])) for load in ("axial", "bending")),
    )
    out.print(f"source: {factors['source']}", markup=False)
    out.print(f"validity: {factors['validity']}\n", markup=False)
    turn = result["largest_rotation"]
    cycles = turn["fatigue_cycles"]
    fatigue = "fatigue limit" + (f" ({cycles:.0e} cycles)" if cycles else "")
    print_table(
        out,
        "Largest rotation under a pure moment",
        ("limit", "mrad", "deg"),
        (
            (name, "-", "-")
            if value is None
            else (name, f"{1e3 * value:.2f}", f"{math.degrees(value):.3f}")
            for name, value in (("yield", turn["before_yield"]), (fatigue, turn["before_fatigue"]))
        ),
    )
