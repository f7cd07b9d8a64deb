"""The fit of all heads or indicators of one setting, for `flexstage centre`."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from flexstage.cli.centre_heads import Head
from flexstage.errors import RecordError

if TYPE_CHECKING:
    from flexstage.centring import Eccentricity, Harmonic, HarmonicFit

__all__ = ["Setting", "setting"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Setting:
    """What was found of the scale in one place.

    Parameters
    ----------
    heads : list of Head
        The heads or indicators.
    fits : sequence of HarmonicFit
        Harmonics of each.
    harmonics : sequence of Harmonic
        Those of the scale, over the angle in it.
    centre : Eccentricity or None
        The eccentricity; None where it was not asked for.
    notes : tuple of str
        What a reader should know.
    """

    heads: list[Head]
    fits: "Sequence[HarmonicFit]"
    harmonics: "Sequence[Harmonic]"
    centre: "Eccentricity | None"
    notes: tuple[str, ...]


def setting(
    heads: list[Head],
    radius: float | None,
    kind: Any,
    orders: list[int] | None,
    robust: bool,
) -> Setting:
    """Fit the heads of one setting.

    Parameters
    ----------
    heads : list of Head
        The heads or indicators.
    radius : float or None
        Radius of the scale [m].
    kind : str
        disc or drum.
    orders : list of int or None
        Orders to fit.
    robust : bool
        Whether to look for outliers.

    Returns
    -------
    Setting
        What was found.

    Raises
    ------
    RecordError
        The columns cannot be fitted, or some are angles and others lengths.
    """
    import numpy as np

    from flexstage.centring import (
        HeadReadings,
        IndicatorReadings,
        eccentricity,
        fit_harmonics,
        run_out,
        scale_harmonic,
    )

    if len({h.radial for h in heads}) > 1:
        raise RecordError("the columns of errors must all be angles, or all lengths")
    radial = heads[0].radial
    unit = "m" if radial else "rad"
    fits = [fit_harmonics(h.angle, h.error, orders=orders, robust=robust, unit=unit) for h in heads]
    alphas = np.array([h.head_angle for h in heads])
    shared = sorted(set.intersection(*(set(f.orders) for f in fits)))
    centre = None
    # where order 1 is left out on purpose, there is nothing to say of the eccentricity
    if radial and 1 in shared:
        ran = [
            IndicatorReadings(angle=h.angle, displacement=h.error, indicator_angle=h.head_angle)
            for h in heads
        ]
        centre = run_out(ran, radius=radius, orders=shared, robust=robust).eccentricity
    elif radius is not None and 1 in shared:
        readings = [
            HeadReadings(angle=h.angle, error=h.error, head_angle=h.head_angle) for h in heads
        ]
        centre = eccentricity(readings, radius=radius, kind=kind, orders=shared, robust=robust)
    notes = [note for f in fits for note in f.notes] + list(centre.notes if centre else ())
    if radius is None and not radial:
        notes.append("give --radius or --diameter for the eccentricity and the move")
    return Setting(
        heads=heads,
        fits=fits,
        harmonics=[scale_harmonic(fits, alphas, n) for n in shared],
        centre=centre,
        notes=tuple(dict.fromkeys(notes)),
    )
