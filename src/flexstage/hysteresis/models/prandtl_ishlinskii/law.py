"""The Prandtl-Ishlinskii model: a weighted sum of plays."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from flexstage.base.errors import ModelError
from flexstage.hysteresis.model import Array, checked, fixed, rising
from flexstage.hysteresis.models.play_model import (
    PlayModel,
    Sum,
    play_parameters,
    plays_c_code,
    plays_matlab_code,
    terms,
)
from flexstage.hysteresis.models.source_code import HysteresisCode


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PrandtlIshlinskii(PlayModel):
    """Prandtl-Ishlinskii operator of play type.

    ``y = gain u + sum_i w_i p_i``, with ``p_i`` the play of u with threshold ``r_i`` (Prandtl 1928;
    Ishlinskii 1944; Krasnosel'skii and Pokrovskii 1983; for piezo drives Kuhnen and Janocha 2001).

    Notes
    -----
    Validity: rate-independent hysteresis with wiping-out (a minor loop that closes leaves no
    trace). Minor loops between the same two inputs are congruent, and every loop is symmetric
    about its centre: asymmetric and saturating loops are beyond it (`ModifiedPrandtlIshlinskii`,
    `Preisach`), and so are loops whose shape depends on the bias, and creep. Beyond the input
    from which the last play moves, the curve is straight.

    Raises
    ------
    ModelError
        Weights are not as many as thresholds, a number is not finite, or the thresholds do not
        rise from above zero.

    Examples
    --------
    >>> model = PrandtlIshlinskii(
    ...     gain=0.4e-6, thresholds=np.array([2.0, 9.0]), weights=np.array([0.1e-6, 0.15e-6])
    ... )
    >>> model.simulate([80.0, 30.0]).values * 1e6
    array([50.45, 21.05])
    """

    kind: ClassVar[str] = "prandtl-ishlinskii"
    title: ClassVar[str] = "Prandtl-Ishlinskii"
    units: ClassVar[Mapping[str, str]] = {
        "gain": "{y}/{u}",
        "thresholds": "{u}",
        "weights": "{y}/{u}",
    }

    gain: float
    """Slope just after the input turns back [m/V]; positive for an inverse that is unique."""
    thresholds: Array
    """Half the gap of each play [V], positive and rising, shape (m,)."""
    weights: Array
    """Weight of each play [m/V], shape (m,); not negative for loops that take in energy."""

    def __post_init__(self) -> None:
        r = rising(self.thresholds, "thresholds of plays", above=0.0)
        weights = fixed(self.weights, "weights of plays", r.shape)
        self._set(gain=checked(self.gain, "gain"), thresholds=r, weights=weights)

    def inverse_plays(self) -> tuple[float, Array, Array]:
        """Return the inverse as a sum of plays of the output, for a controller's own program.

        ``u = g y + sum_i v_i play(y; s_i)`` with ``g = 1/w_0``,
        ``s_i = w_0 r_i + sum_{j<i} w_j (r_i - r_j)`` and ``v_i = -w_i / (a_i a_{i-1})``,
        ``a_i = w_0 + ... + w_i``, where ``w_0`` is the gain (Kuhnen and Janocha 2001). Both start
        at rest. The weights are negative: it is a sum of stops.

        Returns
        -------
        tuple of float, numpy.ndarray and numpy.ndarray
            Gain [V/m], thresholds [m] (m,) and weights [V/m] (m,) of the inverse.

        Raises
        ------
        ModelError
            A slope is not positive, so that there is no unique inverse.
        """
        slopes = self.gain + np.concatenate([[0.0], np.cumsum(self.weights)])
        if np.min(slopes) <= 0.0:
            raise ModelError(
                f"plays have an inverse if all slopes are positive, got {np.min(slopes):g}: "
                f"identify the model with a positive gain and weights that are not negative"
            )
        steps = np.diff(self.thresholds, prepend=0.0)
        thresholds = np.cumsum(slopes[:-1] * steps)
        return 1.0 / self.gain, thresholds, np.diff(1.0 / slopes)

    def play_terms(self) -> Sum:
        return terms(self.gain, self.thresholds, np.empty(0), self.weights[:, None])


def c_code(model: PrandtlIshlinskii) -> HysteresisCode:
    """Return the code in C, whose gain and weights can be changed."""
    return plays_c_code(model, play_parameters(model, model.thresholds))


matlab_code = plays_matlab_code
