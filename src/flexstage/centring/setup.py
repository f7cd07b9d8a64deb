"""Harmonics and eccentricity of a scale in one measurement setup, by all heads or indicators."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from flexstage.centring.eccentricity import (
    Eccentricity,
    HeadReadings,
    eccentricity,
    fit_head,
    run_out,
    with_resolution,
)
from flexstage.centring.geometry import ARCSEC
from flexstage.centring.harmonic_fit import Harmonic, HarmonicFit, distinct_notes, scale_harmonic
from flexstage.files.plain import picked
from flexstage.quantities.estimate import Estimate
from flexstage.quantities.units import si_unit
from flexstage.quantities.units.text import TURN_WORDS


@dataclass(frozen=True, slots=True, kw_only=True)
class Setup:
    """Harmonics and eccentricity of the scale in one measurement setup."""

    heads: Sequence[HeadReadings]
    """The heads or indicators."""
    radial: bool
    """True for indicators, False for heads."""
    fits: Sequence[HarmonicFit]
    """Harmonics of each head."""
    harmonics: Sequence[Harmonic]
    """Harmonics of the scale, over the scale angle."""
    centre: Eccentricity | None
    """The eccentricity; None if it was not requested."""
    with_all: Sequence[Harmonic] | None
    """Harmonics without outlier rejection, if many samples were rejected."""
    centre_with_all: Eccentricity | None
    """Eccentricity without outlier rejection, if many samples were rejected."""
    like_magnet: bool
    """True if the kind was not given and the harmonics are those of an on-axis magnet."""
    notes: tuple[str, ...]
    """Remarks on the result."""


def fit_setup(
    heads: Sequence[HeadReadings],
    radial: bool,
    radius: float | None,
    kind: str | None,
    orders: list[int] | None,
    robust: bool,
) -> Setup:
    """Fit the heads of one setup, or the indicators if `radial`.

    The radius of the scale is in m, `kind` disc, drum or magnet; a disc if None.
    """
    unit = "m" if radial else "rad"
    heads = with_resolution(heads)
    fits = [fit_head(h, orders=orders, robust=robust, unit=unit) for h in heads]
    alphas = np.array([h.head_angle for h in heads])
    shared = sorted(set.intersection(*(set(f.orders) for f in fits)))

    def centre_of_scale(robust: bool) -> Eccentricity | None:
        # order 1 was excluded on purpose: no eccentricity follows
        if 1 not in shared or (radius is None and not radial):
            return None
        if radial:
            return run_out(heads, radius=radius, orders=shared, robust=robust)
        scale_kind: Any = kind or "disc"
        return eccentricity(
            heads, radius=radius or 0.0, kind=scale_kind, orders=shared, robust=robust
        )

    harmonics = [scale_harmonic(fits, alphas, n) for n in shared]
    like_magnet = kind is None and not radial and _second_order_dominates(harmonics)
    centre = None if like_magnet else centre_of_scale(robust)
    fits_with_all = [f if f.with_all is None else f.with_all for f in fits]
    both = any(f.with_all is not None for f in fits)
    notes = [note for f in fits for note in f.notes] + list(centre.notes if centre else ())
    return Setup(
        heads=heads,
        radial=radial,
        fits=fits,
        harmonics=harmonics,
        centre=centre,
        with_all=[scale_harmonic(fits_with_all, alphas, n) for n in shared] if both else None,
        centre_with_all=centre_of_scale(False) if both and centre is not None else None,
        like_magnet=like_magnet,
        notes=distinct_notes(notes),
    )


def _second_order_dominates(harmonics: Sequence[Harmonic]) -> bool:
    """Return whether order 2 is larger than order 1, as for a magnet on the axis."""
    intervals = {h.order: h.amplitude.interval() for h in harmonics}
    return 1 in intervals and 2 in intervals and intervals[2][0] > intervals[1][1]


_WAVES = "A cos(n angle - phase), summed over the orders n"
_OF_HEADS = f"error = reading - true angle = {_WAVES}"
_OF_INDICATORS = f"reading, positive outwards = {_WAVES}"


def report(setup: Setup, mirror: float, mount: float, unit_text: str | None) -> dict[str, Any]:
    """Return the report of one setup, as plain data.

    `mirror` is -1 where the heads travel clockwise, `mount` the direction of the stage's x axis
    [rad], `unit_text` the unit of the printed harmonics.
    """
    radial = setup.radial
    unit, factor = _printed_unit(unit_text, "m" if radial else "rad")
    fit = setup.fits[0]
    out: dict[str, Any] = {
        "records": list(dict.fromkeys(h.file for h in setup.heads)),
        "unit": unit,
        "harmonics": [_harmonic(h, unit, factor, radial) for h in setup.harmonics],
        "offset": factor * fit.offset.value,
        "offset_uncertainty": factor * fit.offset.uncertainty,
        "residual_rms": factor
        * math.sqrt(sum(f.residual_rms**2 for f in setup.fits) / len(setup.fits)),
        "turns": fit.turns,
        "samples": sum(f.samples for f in setup.fits),
        "noise": fit.noise,
        "outliers": [
            {
                "head": h.name,
                "index": o.index,
                "angle_deg": math.degrees(o.angle) % 360.0,
                "value": factor * o.value,
                "residual": factor * o.residual,
                "unit": unit,
            }
            for h, f in zip(setup.heads, setup.fits, strict=True)
            for o in f.outliers
        ],
        "heads": [
            {
                "column": h.name,
                "file": h.file,
                "angle_deg": mirror * math.degrees(h.head_angle),
                "harmonics": [_harmonic(n, unit, factor, radial) for n in f.harmonics],
                "offset": factor * f.offset.value,
                "residual_rms": factor * f.residual_rms,
            }
            for h, f in zip(setup.heads, setup.fits, strict=True)
        ],
        "convention": _OF_INDICATORS if radial else _OF_HEADS,
        "notes": list(setup.notes),
    }
    if setup.with_all is not None:
        out["harmonics_with_all"] = [_harmonic(h, unit, factor, radial) for h in setup.with_all]
    if setup.centre_with_all is not None:
        with_all = _centre_data(setup.centre_with_all, mirror, mount)
        out["eccentricity_with_all"] = with_all["eccentricity"]
    if setup.centre is not None:
        out |= _centre_data(setup.centre, mirror, mount)
    return out


def _printed_unit(text: str | None, si: str) -> tuple[str, float]:
    """Return the printed unit, and the size of the SI unit in it."""
    if text is None:
        return si, 1.0
    if text.strip().lower() in TURN_WORDS:
        return "turn", 0.5 / math.pi
    factor, unit = si_unit(text)
    return (text, 1.0 / factor) if unit == si else (si, 1.0)


def _harmonic(h: Harmonic, unit: str, factor: float, radial: bool) -> dict[str, Any]:
    low, high = h.amplitude.interval()
    return {
        "order": h.order,
        "amplitude": factor * h.amplitude.value,
        "amplitude_uncertainty": factor * h.amplitude.uncertainty,
        "amplitude_interval": [factor * low, factor * high],
        "cosine": factor * h.cosine.value,
        "sine": factor * h.sine.value,
        "phase_deg": math.degrees(h.phase.value),
        "unit": unit,
        "amplitude_arcsec": None if radial else h.amplitude.value / ARCSEC,
        "amplitude_um": 1e6 * h.amplitude.value if radial else None,
    }


def _centre_data(centre: Eccentricity, mirror: float, mount: float) -> dict[str, Any]:
    # the opposite sense of rotation reverses y
    x, y = centre.x.value, mirror * centre.y.value
    c, s = math.cos(mount), math.sin(mount)
    xx, yy = centre.covariance[0, 0], centre.covariance[1, 1]
    xy = mirror * centre.covariance[0, 1]
    low, high = centre.amplitude.interval()
    return {
        "eccentricity": {
            "value": centre.amplitude.value,
            "x": x,
            "y": y,
            "phase_deg": math.degrees(math.atan2(y, x)),
            "uncertainty": centre.amplitude.uncertainty,
            "uncertainty_x": centre.x.uncertainty,
            "uncertainty_y": centre.y.uncertainty,
            "uncertainty_phase_deg": math.degrees(centre.phase.uncertainty),
            "interval": [low, high],
            "unit": "m",
        },
        "move": {
            "x": -(c * x + s * y),
            "y": -(-s * x + c * y),
            "uncertainty_x": math.sqrt(max(c * c * xx + 2.0 * c * s * xy + s * s * yy, 0.0)),
            "uncertainty_y": math.sqrt(max(s * s * xx - 2.0 * c * s * xy + c * c * yy, 0.0)),
            "mounting_angle_deg": math.degrees(mount),
            "unit": "m",
        },
        "reference_error": _plain(centre.common),
        "counter_motion": _plain(centre.counter_motion),
    }


def change(before: Setup, after: Setup, mirror: float, unit_text: str | None) -> dict[str, Any]:
    """Return the change from one setup to the next, as plain data.

    It has the change of the harmonics, and that of the eccentricity, which is the move in between.
    """
    radial = after.radial
    unit, factor = _printed_unit(unit_text, "m" if radial else "rad")
    earlier = {} if radial != before.radial else {h.order: h for h in before.harmonics}
    rows = [
        _harmonic(h.less(earlier[h.order]), unit, factor, radial)
        for h in after.harmonics
        if h.order in earlier
    ]
    out: dict[str, Any] = {"harmonics": rows}
    if before.centre is not None and after.centre is not None:
        pairs = ((after.centre.x, before.centre.x), (after.centre.y, before.centre.y))
        (x, ux), (y, uy) = (
            (new.value - old.value, math.hypot(new.uncertainty, old.uncertainty))
            for new, old in pairs
        )
        out["eccentricity"] = {
            "x": x, "y": mirror * y, "uncertainty_x": ux, "uncertainty_y": uy, "unit": "m",
        }  # fmt: skip
    return out


def _plain(estimate: Estimate | None) -> dict[str, Any] | None:
    return (
        None if estimate is None else picked(estimate, "value", "uncertainty", "interval", "unit")
    )


def joined(reports: list[dict[str, Any]], notes: tuple[str, ...]) -> dict[str, Any]:
    """Return the report of the last setup, with those of all setups if there are several."""
    last = dict(reports[-1])
    last["notes"] = [*last["notes"], *notes]
    if len(reports) > 1:
        last["setups"] = reports
    return last
