"""The Preisach model on plays: a density of memory, without relays."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from flexstage.hysteresis.model import Array, checked, fixed, rising
from flexstage.hysteresis.models.play_model import (
    THRESHOLD,
    PlayModel,
    Sum,
    elements,
    plays_c_code,
    plays_matlab_code,
    terms,
)
from flexstage.hysteresis.models.play_sum import play_columns
from flexstage.hysteresis.models.source_code import HysteresisCode, tunable_of


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Preisach(PlayModel):
    """Preisach operator: a sum of rising, piecewise-linear functions of plays.

    ``y = gain u + sum_i f_i(p_i)``, where ``p_i`` is the play of u with threshold ``r_i``, and
    ``f_i(0) = 0`` with slope ``slopes[i, j]`` between knots j and j + 1.

    A relay that switches up at ``s + r`` and down at ``s - r`` is on exactly if the play with
    threshold r is above s. A Preisach operator (Preisach 1935; Mayergoyz 1991) with a density of
    relays over threshold and mean is therefore a sum of rising functions of plays (Krasnosel'skii
    and Pokrovskii 1983; Brokate and Sprekels 1996, section 2.4): ``slopes[i, j]`` is the density
    of relays with threshold ``r_i`` and means between knots j and j + 1. Relays come in an endless
    number here, and do not quantise the output.

    Notes
    -----
    Validity: rate-independent hysteresis with wiping-out (a minor loop that closes leaves no
    trace) and congruent minor loops (between the same two inputs they differ by a shift only), to
    which the Preisach model is equivalent (Mayergoyz 1986, Phys. Rev. Lett. 56:1518). Asymmetric
    and saturating loops are within it. Loops that drift or change their shape with the output are
    not, nor is creep. Below the first knot and above the last, the functions are extrapolated
    with their outermost slopes.

    Raises
    ------
    ModelError
        Shapes do not match, a number is not finite, or thresholds or knots do not rise.

    Examples
    --------
    >>> model = Preisach(
    ...     thresholds=np.array([2.0, 9.0]),
    ...     knots=np.array([0.0, 40.0, 90.0]),
    ...     slopes=np.array([[0.2e-6, 0.3e-6], [0.1e-6, 0.15e-6]]),
    ...     gain=0.4e-6,
    ... )
    >>> model.simulate([80.0, 30.0]).values * 1e6
    array([60.05, 22.3 ])
    """

    kind: ClassVar[str] = "preisach"
    title: ClassVar[str] = "Preisach"
    units: ClassVar[Mapping[str, str]] = {
        "thresholds": "{u}",
        "knots": "{u}",
        "slopes": "{y}/{u}",
        "gain": "{y}/{u}",
    }

    thresholds: Array
    """Half the gap of each play [V], none negative and rising, shape (m,). Threshold zero is a
    nonlinear gain without memory.
    """
    knots: Array
    """Means where the slopes change [V], rising, shape (k,), at least two."""
    slopes: Array
    """Slope of each play's function between knots [m/V], shape (m, k - 1)."""
    gain: float = 0.0
    """Part of the input itself [m/V]."""

    def __post_init__(self) -> None:
        r = rising(self.thresholds, "thresholds of plays", lowest=0.0)
        k = rising(self.knots, "knots", least=2)
        slopes = fixed(self.slopes, "slopes", (r.size, k.size - 1))
        self._set(thresholds=r, knots=k, slopes=slopes, gain=checked(self.gain, "gain"))

    def play_terms(self) -> Sum:
        # The outermost slopes are extrapolated, so only the inner knots matter.
        return terms(self.gain, self.thresholds, self.knots[1:-1], self.slopes)


def preisach_columns(u: ArrayLike, thresholds: ArrayLike, knots: ArrayLike) -> Array:
    """Return the output of a Preisach model per unit of each of its slopes.

    A model without gain gives ``preisach_columns(u, thresholds, knots) @ slopes.ravel()``.
    Thresholds [V], shape (m,), none negative and rising, and knots [V], shape (k,), at least two,
    as those of the model; columns [V], shape (n, m (k - 1)), play by play, from rest.

    Notes
    -----
    Validity: as `Preisach`.

    Examples
    --------
    >>> preisach_columns([80.0, 30.0], [2.0, 9.0], [0.0, 40.0, 90.0])
    array([[40., 38., 40., 31.],
           [32.,  0., 39.,  0.]])
    """
    plays, k = play_columns(u, thresholds), np.array(knots, dtype=np.float64)
    # the outermost intervals have no outer end
    low, high = np.append(-np.inf, k[1:-1]), np.append(k[1:-1], np.inf)
    ramps = np.clip(plays[:, :, None], low, high)
    ramps -= np.clip(0.0, low, high)
    return ramps.reshape(plays.shape[0], -1)


def c_code(model: Preisach) -> HysteresisCode:
    """Return the code in C; the gain alone can be changed, as tables hold knots and slopes."""
    tunable = [
        tunable_of(model, "gain", 2, "part of the voltage itself"),
        *elements(model, "thresholds", model.thresholds, THRESHOLD),
        *elements(model, "knots", model.knots, "mean where the density changes"),
        *(
            tunable_of(model, f"slopes[{i},{j}]", None, "density of the memory")
            for i, j in np.ndindex(*model.slopes.shape)
        ),
    ]
    return plays_c_code(model, tunable)


matlab_code = plays_matlab_code
