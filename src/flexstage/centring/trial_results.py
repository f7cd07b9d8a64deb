"""How the harmonics of settings follow the positions of the stage, as plain data."""

import math
from collections.abc import Sequence
from typing import Any

from flexstage.centring.record_heads import MAGNET
from flexstage.centring.setting import Setting
from flexstage.centring.trial_moves import OrderResponse, response_to_moves
from flexstage.errors import RecordError


def trial(
    settings: Sequence[Setting], positions: Sequence[tuple[float, float]], kind: str | None
) -> dict[str, Any]:
    """Return how the harmonics of settings follow the positions, as plain data."""
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
        "notes": _notes(best, kind, len(settings), last),
    }
    if best is not None and best.x is not None and best.y is not None:
        out["centre"] = {
            "x": best.x.value, "y": best.y.value, "unit": "m",
            "uncertainty_x": best.x.uncertainty, "uncertainty_y": best.y.uncertainty,
            "move_from_last": [best.x.value - last[0], best.y.value - last[1]],
        }  # fmt: skip
    return out


def _best(found: list[OrderResponse], kind: str | None) -> OrderResponse | None:
    """The order that eccentricity shows in: 1, but of a magnet the one that says most of it."""
    known = [r for r in found if r.x is not None and r.y is not None]
    if kind != MAGNET:
        return next((r for r in known if r.order == 1 and r.follows == "in proportion"), None)
    return min(known, key=_unsure, default=None)


def _unsure(r: OrderResponse) -> float:
    return math.inf if r.x is None or r.y is None else math.hypot(r.x.uncertainty, r.y.uncertainty)


def _plain(r: OrderResponse) -> dict[str, Any]:
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


def _notes(
    best: OrderResponse | None, kind: str | None, count: int, last: tuple[float, float]
) -> list[str]:
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
    if _is_there(best, last):
        notes.append(
            "the move from the last position is within its uncertainty: the scale is centred as "
            "well as these records tell"
        )
    if best.follows == "in proportion":
        notes.append(
            f"there the whole of order {best.order} vanishes, with what of it is the scale's or "
            "its signals' own: measure again there"
        )
    return notes


def _is_there(best: OrderResponse, last: tuple[float, float]) -> bool:
    """Say whether a position is the centre, as far as that is known with 95 % confidence."""
    return (
        best.x is not None
        and best.y is not None
        and best.x.covers(last[0])
        and best.y.covers(last[1])
    )
