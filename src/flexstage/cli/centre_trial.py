"""Trial moves in `flexstage centre`: records taken at known positions of the stage."""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from flexstage.cli.centre_heads import MAGNET
from flexstage.cli.options import quantity
from flexstage.cli.output import console, print_notes, print_table
from flexstage.errors import RecordError

if TYPE_CHECKING:
    from flexstage.centring.setting import Setting
    from flexstage.centring.trial_moves import OrderResponse

_ARCSEC = math.pi / 648_000.0
_UNITS = {"in proportion": "µm", "as the square": "µm²"}


def positions_of(text: str, settings: int) -> list[tuple[float, float]]:
    """Return the positions x, y of the stage [m] that --stage-at gives, one for each setting."""
    pairs = [pair.split(",") for pair in text.split(";") if pair.strip()]
    if any(len(pair) != 2 for pair in pairs):
        raise RecordError(
            f"--stage-at gives x,y for each setting, such as '0,0; 20,0; 0,20' in um, got '{text}'"
        )
    if len(pairs) != settings or settings < 3:
        raise RecordError(
            f"--stage-at needs a position for each setting, and three settings at least: got "
            f"{len(pairs)} positions and {settings} settings"
        )
    x, y = ([quantity(p[k].strip(), "length", bare_unit="um") for p in pairs] for k in (0, 1))
    return list(zip(x, y, strict=True))


def trial(
    settings: "Sequence[Setting]", positions: Sequence[tuple[float, float]], kind: str | None
) -> dict[str, Any]:
    """Return how the harmonics of settings follow the positions, as plain data."""
    from flexstage.centring import response_to_moves

    if kind == MAGNET and len(settings) < 4:
        raise RecordError(
            "which order of a magnet follows the stage, in proportion or as the square, takes four "
            "positions, better five: measure at one more, such as '20,20'"
        )
    at = [{h.order: h for h in s.harmonics} for s in settings]
    shared = sorted(set.intersection(*(set(one) for one in at)))
    found = [response_to_moves(positions, [one[n] for one in at]) for n in shared]
    best = _best(found, kind)
    last = positions[-1]
    out: dict[str, Any] = {
        "positions": [list(p) for p in positions],
        "unit": "m",
        "harmonic_unit": "m" if settings[0].heads[0].radial else "rad",
        "orders": [_plain(r) for r in found],
        "order": None if best is None else best.order,
        "notes": _notes(best, kind, len(settings)),
    }
    if best is not None and best.x is not None and best.y is not None:
        out["centre"] = {
            "x": best.x.value, "y": best.y.value, "unit": "m",
            "uncertainty_x": best.x.uncertainty, "uncertainty_y": best.y.uncertainty,
            "move_from_last": [best.x.value - last[0], best.y.value - last[1]],
        }  # fmt: skip
    return out


def _best(found: "list[OrderResponse]", kind: str | None) -> "OrderResponse | None":
    """The order that eccentricity shows in: 1, but of a magnet the one that says most of it."""
    known = [r for r in found if r.x is not None and r.y is not None]
    if kind != MAGNET:
        return next((r for r in known if r.order == 1 and r.follows == "in proportion"), None)
    return min(known, key=_unsure, default=None)


def _unsure(r: "OrderResponse") -> float:
    return math.inf if r.x is None or r.y is None else math.hypot(r.x.uncertainty, r.y.uncertainty)


def _plain(r: "OrderResponse") -> dict[str, Any]:
    return {
        "order": r.order,
        "change": r.change,
        "left": r.left,
        "follows": r.follows,
        "gain": r.gain,
        "x": None if r.x is None else r.x.value,
        "y": None if r.y is None else r.y.value,
        "uncertainty_x": None if r.x is None else r.x.uncertainty,
        "uncertainty_y": None if r.y is None else r.y.uncertainty,
    }


def _notes(best: "OrderResponse | None", kind: str | None, count: int) -> list[str]:
    if best is None:
        which = "no order follows" if kind == MAGNET else "order 1 does not follow"
        return [
            f"{which} the positions in both directions: no centre is given; check --stage-at, make "
            "the moves larger, or measure at more positions"
        ]
    notes = []
    if count == 3:
        notes.append(
            "three positions are as many as proportion has numbers: a fourth would show whether it "
            "holds"
        )
    if best.follows == "in proportion":
        notes.append(
            f"there the whole of order {best.order} vanishes, with what of it is the scale's or "
            "its signals' own: measure again there"
        )
    return notes


def _place(row: dict[str, Any], axis: str) -> str:
    if row[axis] is None:
        return ""
    return f"{1e6 * row[axis]:.3f} ± {1e6 * row[f'uncertainty_{axis}']:.2g}"


def print_trial(result: dict[str, Any]) -> None:
    """Print how the harmonics follow the positions."""
    screen = console()
    unit, size = ("arcsec", _ARCSEC) if result["harmonic_unit"] == "rad" else ("µm", 1e-6)
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
        f"left, {unit}",
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
