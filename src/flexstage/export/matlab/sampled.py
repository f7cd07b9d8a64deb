"""The linear part of a model from sample to sample."""

from dataclasses import dataclass

import numpy as np

from flexstage.export.control_object import linear_part
from flexstage.export.model import DynamicModel
from flexstage.hysteresis.model import Array


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SampledForm:
    """x' = transition x + start w + end w' over one step, for inputs of straight lines."""

    transition: Array
    """What the state does to the next one, shape (n, n)."""
    start: Array
    """What the input at the start of the step does, shape (n, m)."""
    end: Array
    """What the input at its end does, shape (n, m)."""

    @property
    def held(self) -> Array:
        """What an input that is held through the step does, shape (n, m)."""
        return self.start + self.end

    @property
    def shifted(self) -> Array:
        """Input matrix for the state ``x - end w``, which needs no input of the future."""
        return self.start + self.transition @ self.end


def sampled_form(model: DynamicModel) -> SampledForm:
    """Return what one step does to the states of `linear_part`, exact to rounding.

    Modes do not act on one another, so each is taken with the lags alone: the exponential of the
    matrix of (mode, its rate over omega, lags, inputs, their rises), C. F. Van Loan, IEEE Trans.
    Autom. Control 23 (1978) 395.
    """
    from scipy.linalg import expm

    form, h, k = linear_part(model), model.step, model.omega.size
    n, m = form.B.shape
    lags = n - 2 * k
    size = 2 + lags
    block = np.zeros((k, size + 2 * m, size + 2 * m))
    index = np.array([[i, k + i, *range(2 * k, n)] for i in range(k)])
    # rates over omega, so that numbers of a block are of one size
    scale = np.ones((k, size))
    scale[:, 1] = model.omega
    own = form.A[index[:, :, None], index[:, None, :]]
    block[:, :size, :size] = h * own * scale[:, None, :] / scale[:, :, None]
    block[:, :size, size : size + m] = h * form.B[index] / scale[:, :, None]
    block[:, size : size + m, size + m :] = np.eye(m)
    e = np.asarray(expm(block), dtype=np.float64)
    transition = np.zeros((n, n))
    constant, rise = np.zeros((n, m)), np.zeros((n, m))
    for i in range(k):
        rows = index[i]
        transition[np.ix_(rows, rows)] = e[i, :size, :size] * scale[i][:, None] / scale[i][None, :]
        constant[rows] = e[i, :size, size : size + m] * scale[i][:, None]
        rise[rows] = e[i, :size, size + m :] * scale[i][:, None]
    return SampledForm(transition=transition, start=constant - rise, end=rise)
