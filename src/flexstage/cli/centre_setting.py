"""The fit of all heads or indicators of one setting, for `flexstage centre`."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from flexstage.cli.centre_heads import Head
from flexstage.errors import RecordError

if TYPE_CHECKING:
    from flexstage.centring import Eccentricity, Harmonic
    from flexstage.centring.harmonic_fit import HarmonicFit

#: A magnet of one pair of poles on the axis, as `--kind` has it.
MAGNET = "magnet"


@dataclass(frozen=True, slots=True, kw_only=True)
class Setting:
    """What was found of the scale in one place."""

    heads: list[Head]
    """The heads or indicators."""
    fits: "Sequence[HarmonicFit]"
    """Harmonics of each."""
    harmonics: "Sequence[Harmonic]"
    """Those of the scale, over the angle in it."""
    centre: "Eccentricity | None"
    """The eccentricity; None where it was not asked for."""
    with_all: "Sequence[Harmonic] | None"
    """Those with no sample set aside, where so many were that both are needed."""
    centre_with_all: "Eccentricity | None"
    """The eccentricity with no sample set aside, then."""
    notes: tuple[str, ...]
    """What a reader should know."""


def setting(
    heads: list[Head],
    radius: float | None,
    kind: str | None,
    orders: list[int] | None,
    robust: bool,
    *,
    on_trial: bool = False,
) -> Setting:
    """Fit the heads of one setting.

    `kind` is disc, drum or magnet; a disc where None. `on_trial`: one of several at known
    positions.
    """
    import numpy as np

    from flexstage.centring import (
        HeadReadings,
        IndicatorReadings,
        eccentricity,
        fit_harmonics,
        run_out,
    )
    from flexstage.centring.harmonic_fit import scale_harmonic

    if len({h.radial for h in heads}) > 1:
        raise RecordError("the columns of errors must all be angles, or all lengths")
    radial = heads[0].radial
    unit = "m" if radial else "rad"
    fits = [fit_harmonics(h.angle, h.error, orders=orders, robust=robust, unit=unit) for h in heads]
    alphas = np.array([h.head_angle for h in heads])
    shared = sorted(set.intersection(*(set(f.orders) for f in fits)))

    def centred(look: bool) -> "Eccentricity | None":
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
    if not radial and not on_trial:
        notes += _of_the_kind(kind, radius is not None, like_magnet)
    return Setting(
        heads=heads,
        fits=fits,
        harmonics=harmonics,
        centre=centre,
        with_all=[scale_harmonic(whole, alphas, n) for n in shared] if both else None,
        centre_with_all=centred(False) if both and centre is not None else None,
        notes=tuple(dict.fromkeys(notes)),
    )


def _second_leads(harmonics: "Sequence[Harmonic]") -> bool:
    """Say whether order 2 is larger than order 1, as of a magnet on the axis."""
    found = {h.order: h.amplitude.interval() for h in harmonics}
    return 1 in found and 2 in found and found[2][0] > found[1][1]


def _of_the_kind(kind: str | None, sized: bool, like_magnet: bool) -> list[str]:
    """Say what the harmonic of order 1 is, of a scale of that kind."""
    if kind == MAGNET:
        return [
            "of a magnet on the axis that a few probes read, order 1 is that of offsets of their "
            "signals as well, and in which orders eccentricity shows hangs on how the probes are "
            "joined: no move follows from one record; measure at four positions of the stage or "
            "more, and give them by --stage-at"
        ]
    if not sized:
        return [
            "give --radius or --diameter for the eccentricity and the move, if lines or many poles "
            "are read there; order 1 of a magnet on the axis is no eccentricity alone"
        ]
    if like_magnet:
        return [
            "order 2 is larger than order 1, as of a magnet on the axis, whose order 1 is no "
            "eccentricity alone: no move is given; say --kind disc or drum if lines or many poles "
            "are read at the radius"
        ]
    if kind is None:
        return [
            "taken for a disc, of lines or many poles that are read at the radius: of a magnet on "
            "the axis order 1 is no eccentricity alone; --kind says which"
        ]
    return []
