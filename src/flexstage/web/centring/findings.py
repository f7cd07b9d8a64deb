"""What was found of a scale, as the view Centring shows it: figures, and a row for each turn."""

from typing import Any

from flexstage.centring import ARCSEC
from flexstage.quantities.quantity import beside, number
from flexstage.quantities.table import Table, table
from flexstage.web.bench.readouts import shown_number
from flexstage.web.centring.state import CentringState
from flexstage.web.live.history import POSITION
from flexstage.web.page import in_page_words
from flexstage.web.preferences import Preferences

_KINDS = {"start": "start", "trial": "trial move", "move": "move"}


def pair(value: float, uncertainty: float, factor: float) -> str:
    """Write a value and its standard uncertainty, in a unit of so many in the SI unit."""
    return in_page_words(" ± ".join(beside(factor * value, factor * uncertainty)))


def place(at: tuple[float, float], preferences: Preferences) -> str:
    """Write a place of the stage."""
    shown = preferences.shown(POSITION)
    both = (f"{n} {shown_number(shown, v)}" for n, v in zip("xy", at, strict=True))
    return f"{', '.join(both)} {shown.shown_unit}"


def figures(
    found: dict[str, Any], radius: float | None, preferences: Preferences
) -> list[tuple[str, str, str]]:
    """Return name, value and remark of the figures of one turn, the main one first."""
    unit, factor = preferences.length_unit()
    shown: list[tuple[str, str, str]] = []
    if (e := found.get("eccentricity")) is not None:
        unsure = factor * e["uncertainty"]
        low, high = (beside(factor * end, unsure)[0] for end in e["interval"])
        value = f"{pair(e['value'], e['uncertainty'], factor)} {unit}"
        shown.append(("Eccentricity", value, f"95 %: {low} to {high} {unit}"))
    if (first := first_order(found, radius)) is not None:
        shown.append(("Error once per turn", f"{pair(*first, 1.0)} arcsec", "amplitude"))
    shown.append(("Rest beside the fit", residual(found, preferences), "rms"))
    return shown


def first_order(found: dict[str, Any], radius: float | None) -> tuple[float, float] | None:
    """Return the amplitude of the error of order 1 and its standard uncertainty [arcsec].

    Of a gauge it is that of a scale with this radius.
    """
    first = next((h for h in found["harmonics"] if h["order"] == 1), None)
    if first is None:
        return None
    size = first["amplitude_arcsec"]
    if size is None:
        if radius is None:
            return None
        size = 1e-6 * first["amplitude_um"] / radius / ARCSEC
    amplitude = first["amplitude"]
    return size, first["amplitude_uncertainty"] * (size / amplitude if amplitude else 0.0)


def residual(found: dict[str, Any], preferences: Preferences) -> str:
    """Write what the harmonics leave."""
    first = found["harmonics"][0]
    left, size = found["residual_rms"], first["amplitude"]
    if first["amplitude_arcsec"] is not None:
        return f"{number(left * first['amplitude_arcsec'] / size, 3)} arcsec" if size else "–"
    unit, factor = preferences.length_unit()
    return (
        f"{number(left * factor * 1e-6 * first['amplitude_um'] / size, 3)} {unit}" if size else "–"
    )


def rows_of(state: CentringState, preferences: Preferences) -> Table:
    """Return a row for each turn that was measured."""
    unit, factor = preferences.length_unit()
    heads = (
        "turn", f"stage x [{unit}]", f"y [{unit}]", f"eccentricity [{unit}]", "direction [°]",
        "once per turn [arcsec]", "rest, rms",
    )  # fmt: skip
    found = state.found.setups if state.found is not None and state.up_to_date else []
    rows = []
    for i, each in enumerate(state.measured):
        at = [shown_number(preferences.shown(POSITION), v) for v in each.at]
        cells = ["…"] * 4
        if i < len(found):
            e, first = found[i].get("eccentricity"), first_order(found[i], state.request.radius)
            cells = [
                "–" if e is None else pair(e["value"], e["uncertainty"], factor),
                "–" if e is None else in_page_words(f"{e['phase_deg']:.1f}"),
                "–" if first is None else pair(*first, 1.0),
                residual(found[i], preferences),
            ]
        rows.append((f"{i + 1} {_KINDS[each.kind]}", *at, *cells))
    return table("", heads, rows)
