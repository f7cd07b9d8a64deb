"""One setting: harmonics and eccentricity of the scale by all heads or indicators, as data."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from flexstage.centring.eccentricity import Eccentricity, HeadReadings, eccentricity, run_out
from flexstage.centring.geometry import ARCSEC
from flexstage.centring.harmonic_fit import Harmonic, HarmonicFit, scale_harmonic
from flexstage.centring.harmonics import fit_harmonics
from flexstage.files.plain import picked
from flexstage.quantities.estimate import Estimate
from flexstage.quantities.units import si_unit
from flexstage.quantities.units.text import TURN_WORDS


@dataclass(frozen=True, slots=True, kw_only=True)
class Setting:
    """What was found of the scale in one place."""

    heads: Sequence[HeadReadings]
    """The heads or indicators."""
    radial: bool
    """Whether they are indicators."""
    fits: Sequence[HarmonicFit]
    """Harmonics of each."""
    harmonics: Sequence[Harmonic]
    """Those of the scale, over the angle in it."""
    centre: Eccentricity | None
    """The eccentricity; None where it was not asked for."""
    with_all: Sequence[Harmonic] | None
    """Those with no sample set aside, where so many were that both are needed."""
    centre_with_all: Eccentricity | None
    """The eccentricity with no sample set aside, then."""
    like_magnet: bool
    """Whether it was not said to be of a kind and looks as if it were a magnet on the axis."""
    notes: tuple[str, ...]
    """What a reader should know."""


def fit_setting(
    heads: Sequence[HeadReadings],
    radial: bool,
    radius: float | None,
    kind: str | None,
    orders: list[int] | None,
    robust: bool,
) -> Setting:
    """Fit the heads of one setting, or the indicators where `radial`.

    The radius of the scale is in m, `kind` disc, drum or magnet; a disc where None.
    """
    unit = "m" if radial else "rad"
    fits = [fit_harmonics(h.angle, h.error, orders=orders, robust=robust, unit=unit) for h in heads]
    alphas = np.array([h.head_angle for h in heads])
    shared = sorted(set.intersection(*(set(f.orders) for f in fits)))

    def centred(look: bool) -> Eccentricity | None:
        # where order 1 is left out on purpose, there is nothing to say of the eccentricity
        if 1 not in shared or (radius is None and not radial):
            return None
        if radial:
            return run_out(heads, radius=radius, orders=shared, robust=look)
        own: Any = kind or "disc"
        return eccentricity(heads, radius=radius or 0.0, kind=own, orders=shared, robust=look)

    harmonics = [scale_harmonic(fits, alphas, n) for n in shared]
    like_magnet = kind is None and not radial and _second_leads(harmonics)
    centre = None if like_magnet else centred(robust)
    whole = [f if f.with_all is None else f.with_all for f in fits]
    both = any(f.with_all is not None for f in fits)
    notes = [note for f in fits for note in f.notes] + list(centre.notes if centre else ())
    return Setting(
        heads=heads,
        radial=radial,
        fits=fits,
        harmonics=harmonics,
        centre=centre,
        with_all=[scale_harmonic(whole, alphas, n) for n in shared] if both else None,
        centre_with_all=centred(False) if both and centre is not None else None,
        like_magnet=like_magnet,
        notes=tuple(dict.fromkeys(notes)),
    )


def _second_leads(harmonics: Sequence[Harmonic]) -> bool:
    """Say whether order 2 is larger than order 1, as of a magnet on the axis."""
    found = {h.order: h.amplitude.interval() for h in harmonics}
    return 1 in found and 2 in found and found[2][0] > found[1][1]


_WAVES = "A cos(n angle - phase), summed over the orders n"
_OF_HEADS = f"angle read less true angle is {_WAVES}"
_OF_INDICATORS = f"what is read, outwards more, is {_WAVES}"


def report(setting: Setting, mirror: float, mount: float, written: str | None) -> dict[str, Any]:
    """Return what is said of one setting, as plain data.

    `mirror` is -1 where the heads travel clockwise, `mount` the direction of the stage's x axis
    [rad], `written` the unit that harmonics are printed in.
    """
    radial = setting.radial
    unit, factor = _written(written, "m" if radial else "rad")
    fit = setting.fits[0]
    out: dict[str, Any] = {
        "records": list(dict.fromkeys(h.file for h in setting.heads)),
        "unit": unit,
        "harmonics": [_harmonic(h, unit, factor, radial) for h in setting.harmonics],
        "offset": factor * fit.offset.value,
        "offset_uncertainty": factor * fit.offset.uncertainty,
        "residual_rms": factor
        * math.sqrt(sum(f.residual_rms**2 for f in setting.fits) / len(setting.fits)),
        "turns": fit.turns,
        "samples": sum(f.samples for f in setting.fits),
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
            for h, f in zip(setting.heads, setting.fits, strict=True)
            for o in f.outliers
        ],
        "heads": [
            {
                "column": h.name,
                "file": h.file,
                "angle_deg": mirror * math.degrees(h.head_angle),
                "harmonics": [_harmonic(own, unit, factor, radial) for own in f.harmonics],
                "offset": factor * f.offset.value,
                "residual_rms": factor * f.residual_rms,
            }
            for h, f in zip(setting.heads, setting.fits, strict=True)
        ],
        "convention": _OF_INDICATORS if radial else _OF_HEADS,
        "notes": list(setting.notes),
    }
    if setting.with_all is not None:
        out["harmonics_with_all"] = [_harmonic(h, unit, factor, radial) for h in setting.with_all]
    if setting.centre_with_all is not None:
        whole = _centred(setting.centre_with_all, mirror, mount)
        out["eccentricity_with_all"] = whole["eccentricity"]
    if setting.centre is not None:
        out |= _centred(setting.centre, mirror, mount)
    return out


def _written(text: str | None, si: str) -> tuple[str, float]:
    """Return the unit that is printed, and how many of it the SI unit is."""
    if text is None:
        return si, 1.0
    if text.strip().lower() in TURN_WORDS:
        return "turn", 0.5 / math.pi
    factor, known = si_unit(text)
    return (text, 1.0 / factor) if known == si else (si, 1.0)


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


def _centred(found: Eccentricity, mirror: float, mount: float) -> dict[str, Any]:
    # the other sense has y the other way
    x, y = found.x.value, mirror * found.y.value
    c, s = math.cos(mount), math.sin(mount)
    xx, yy = found.covariance[0, 0], found.covariance[1, 1]
    xy = mirror * found.covariance[0, 1]
    low, high = found.amplitude.interval()
    return {
        "eccentricity": {
            "value": found.amplitude.value,
            "x": x,
            "y": y,
            "phase_deg": math.degrees(math.atan2(y, x)),
            "uncertainty": found.amplitude.uncertainty,
            "uncertainty_x": found.x.uncertainty,
            "uncertainty_y": found.y.uncertainty,
            "uncertainty_phase_deg": math.degrees(found.phase.uncertainty),
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
        "reference_error": _plain(found.common),
        "counter_motion": _plain(found.counter_motion),
    }


def change(before: Setting, after: Setting, mirror: float, written: str | None) -> dict[str, Any]:
    """Return how one setting differs from that before it, as plain data.

    Harmonics of the difference; and of the eccentricity, which is the move in between.
    """
    radial = after.radial
    unit, factor = _written(written, "m" if radial else "rad")
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
    """Return the last setting, with all of them where there are several."""
    last = dict(reports[-1])
    last["notes"] = [*last["notes"], *notes]
    if len(reports) > 1:
        last["settings"] = reports
    return last
