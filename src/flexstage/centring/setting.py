"""The fit of all heads or indicators of one setting: harmonics of the scale, its eccentricity."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from flexstage.arrays import Array
from flexstage.centring.eccentricity import HeadReadings, eccentricity
from flexstage.centring.first_order import Eccentricity
from flexstage.centring.harmonic_fit import Harmonic, HarmonicFit, scale_harmonic
from flexstage.centring.harmonics import fit_harmonics
from flexstage.centring.indicators import IndicatorReadings, run_out
from flexstage.errors import RecordError


@dataclass(frozen=True, slots=True, kw_only=True)
class Head:
    """A column of errors, in SI, with the angles that belong to it."""

    name: str
    """Name of the column."""
    file: str
    """File that it is from."""
    angle: Array
    """Angle of the table [rad], shape (n,)."""
    error: Array
    """Error [rad], or what an indicator reads [m], shape (n,)."""
    head_angle: float
    """Where the head stands [rad], as the head travels."""
    radial: bool
    """Whether it is an indicator."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Setting:
    """What was found of the scale in one place."""

    heads: list[Head]
    """The heads or indicators."""
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
    heads: list[Head],
    radius: float | None,
    kind: str | None,
    orders: list[int] | None,
    robust: bool,
) -> Setting:
    """Fit the heads of one setting.

    The radius of the scale is in m, `kind` disc, drum or magnet; a disc where None.
    """
    if len({h.radial for h in heads}) > 1:
        raise RecordError("the columns of errors must all be angles, or all lengths")
    radial = heads[0].radial
    unit = "m" if radial else "rad"
    fits = [fit_harmonics(h.angle, h.error, orders=orders, robust=robust, unit=unit) for h in heads]
    alphas = np.array([h.head_angle for h in heads])
    shared = sorted(set.intersection(*(set(f.orders) for f in fits)))

    def centred(look: bool) -> Eccentricity | None:
        # where order 1 is left out on purpose, there is nothing to say of the eccentricity
        if 1 not in shared or (radius is None and not radial):
            return None
        if radial:
            ran = [
                IndicatorReadings(angle=h.angle, displacement=h.error, indicator_angle=h.head_angle)
                for h in heads
            ]
            return run_out(ran, radius=radius, orders=shared, robust=look).eccentricity
        readings = [
            HeadReadings(angle=h.angle, error=h.error, head_angle=h.head_angle) for h in heads
        ]
        own: Any = kind or "disc"
        return eccentricity(readings, radius=radius or 0.0, kind=own, orders=shared, robust=look)

    harmonics = [scale_harmonic(fits, alphas, n) for n in shared]
    like_magnet = kind is None and not radial and _second_leads(harmonics)
    centre = None if like_magnet else centred(robust)
    whole = [f if f.with_all is None else f.with_all for f in fits]
    both = any(f.with_all is not None for f in fits)
    notes = [note for f in fits for note in f.notes] + list(centre.notes if centre else ())
    return Setting(
        heads=heads,
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
