"""What `flexstage centre` prints of trial moves: records taken at known positions of the stage."""

from typing import Any

from flexstage.cli.output import console, print_notes, print_table

_UNITS = {"in proportion": "µm", "as the square": "µm²"}


def _place(row: dict[str, Any], axis: str) -> str:
    if row[axis] is None:
        return ""
    return f"{1e6 * row[axis]:.3f} ± {1e6 * row[f'uncertainty_{axis}']:.2g}"


def print_trial(result: dict[str, Any]) -> None:
    """Print how the harmonics follow the positions."""
    from flexstage.centring.geometry import ARCSEC

    screen = console()
    unit, size = ("arcsec", ARCSEC) if result["harmonic_unit"] == "rad" else ("µm", 1e-6)
    rows = []
    for row in result["orders"]:
        gain = ""
        if row["follows"] is not None:
            power = 2 if row["follows"] == "as the square" else 1
            gain = f"{row['gain'] / size * 1e-6**power:.4g} {unit}/{_UNITS[row['follows']]}"
        sizes = (f"{row[key] / size:.4g}" for key in ("change", "left"))
        places = (_place(row, axis) for axis in ("x", "y"))
        rows.append((row["order"], *sizes, row["follows"] or "no", gain, *places))
    heads = (
        "order",
        f"change, {unit}",
        f"~left, {unit}",
        "<follows",
        "<gain",
        "centre x, µm",
        "y, µm",
    )
    title = f"what follows {len(result['positions'])} positions of the stage"
    print_table(screen, title, heads, rows)
    if "centre" in result:
        c = result["centre"]
        dx, dy = (1e6 * v for v in c["move_from_last"])
        screen.print(
            f"by order {result['order']} the centre is at x {1e6 * c['x']:+.4f} ± "
            f"{1e6 * c['uncertainty_x']:.2g} µm, y {1e6 * c['y']:+.4f} ± "
            f"{1e6 * c['uncertainty_y']:.2g} µm of the stage (standard uncertainty): from the last "
            f"position by {dx:+.4f}, {dy:+.4f} µm",
            markup=False,
        )
    print_notes(screen, result["notes"])
