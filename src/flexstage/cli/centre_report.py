"""What `flexstage centre` prints of a setting: its tables."""

from typing import Any

from flexstage.cli.output import console, print_notes, print_table

#: Places of outliers that are printed.
_PLACES = 6


def print_setting(result: dict[str, Any]) -> None:
    """Print what is said of one setting."""
    screen = console()
    whole = result.get("harmonics_with_all")
    _print_harmonics(f"harmonics: {', '.join(result['records'])}", result["harmonics"], whole)
    screen.print(result["convention"], markup=False)
    unit, _, per = _shown(result["harmonics"])
    screen.print(
        f"{result['samples']} samples over {result['turns']:.2f} turns; left over "
        f"{per * result['residual_rms']:.4g} {unit} rms"
    )
    if "eccentricity" in result:
        _print_centre(result["eccentricity"], result["move"])
    if "eccentricity_with_all" in result:
        e = result["eccentricity_with_all"]
        screen.print(
            f"with all samples: eccentricity {1e6 * e['value']:.4f} µm, in the direction "
            f"{e['phase_deg']:.2f} deg"
        )
    if "change" in result:
        _print_change(result["change"])
    if result["outliers"]:
        screen.print(_outliers(result), style="yellow", markup=False)
    print_notes(screen, result["notes"])


def _print_harmonics(
    title: str, harmonics: list[dict[str, Any]], whole: list[dict[str, Any]] | None
) -> None:
    unit, key, per = _shown(harmonics)
    heads = ["order", f"amplitude, {unit}", "95 % interval", "phase, deg"]
    rows = []
    for i, h in enumerate(harmonics):
        low, high = (per * end for end in h["amplitude_interval"])
        row = [h["order"], f"{h[key]:.5g}", f"{low:.4g} to {high:.4g}", f"{h['phase_deg']:.2f}"]
        rows.append(row if whole is None else [*row, f"{whole[i][key]:.5g}"])
    print_table(console(), title, heads if whole is None else [*heads, "with all samples"], rows)


def _shown(harmonics: list[dict[str, Any]]) -> tuple[str, str, float]:
    """Return the unit of harmonics, where they have their amplitude in it, and its size."""
    radial = any(h["amplitude_um"] is not None for h in harmonics)
    unit, key = ("µm", "amplitude_um") if radial else ("arcsec", "amplitude_arcsec")
    return unit, key, next((h[key] / h["amplitude"] for h in harmonics if h["amplitude"]), 0.0)


def _outliers(result: dict[str, Any]) -> str:
    """Say how many samples were set aside, where, and which is the largest."""
    found = result["outliers"]
    places = sorted({round(o["angle_deg"], 2) for o in found})
    most = max(found, key=lambda o: abs(o["residual"]))
    more = len(places) - _PLACES
    unit, _, per = _shown(result["harmonics"])
    return (
        f"outliers: {len(found)} set aside, at "
        + ", ".join(f"{p:.2f}" for p in places[:_PLACES])
        + (f" deg and {more} places more" if more > 0 else " deg")
        + f"; the largest, sample {most['index']} of '{most['head']}' at {most['angle_deg']:.2f} "
        f"deg, is {per * most['residual']:.4g} {unit} off"
    )


def _print_change(found: dict[str, Any]) -> None:
    _print_harmonics("change from the record before", found["harmonics"], None)
    if "eccentricity" in found:
        e = found["eccentricity"]
        console().print(
            f"the centre of the scale went by x {1e6 * e['x']:+.4f} ± "
            f"{1e6 * e['uncertainty_x']:.4f} µm, y {1e6 * e['y']:+.4f} ± "
            f"{1e6 * e['uncertainty_y']:.4f} µm (standard uncertainty)"
        )


def _print_centre(found: dict[str, Any], move: dict[str, Any]) -> None:
    low, high = (1e6 * end for end in found["interval"])
    screen = console()
    screen.print(
        f"eccentricity {1e6 * found['value']:.4f} µm ({low:.4f} to {high:.4f}), in the direction "
        f"{found['phase_deg']:.2f} deg"
    )
    screen.print(
        f"move of the stage: x {1e6 * move['x']:+.4f} ± {1e6 * move['uncertainty_x']:.4f} µm, "
        f"y {1e6 * move['y']:+.4f} ± {1e6 * move['uncertainty_y']:.4f} µm (standard uncertainty)"
    )


_UNITS = {"linear": "µm", "quadratic": "µm²"}


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
        if row["relation"] is not None:
            power = 2 if row["relation"] == "quadratic" else 1
            gain = f"{row['gain'] / size * 1e-6**power:.4g} {unit}/{_UNITS[row['relation']]}"
        sizes = (f"{row[key] / size:.4g}" for key in ("change", "residual"))
        places = (_place(row, axis) for axis in ("x", "y"))
        rows.append((row["order"], *sizes, row["relation"] or "none", gain, *places))
    heads = (
        "order",
        f"change, {unit}",
        f"~residual, {unit}",
        "<relation",
        "<gain",
        "centre x, µm",
        "y, µm",
    )
    title = f"response to {len(result['positions'])} positions of the stage"
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
