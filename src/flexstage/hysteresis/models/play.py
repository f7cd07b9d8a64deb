"""The play (backlash): the memory of every model that is piecewise linear."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexstage.base.errors import ModelError
from flexstage.hysteresis.compiled import compiled
from flexstage.hysteresis.model import Array

Indices = NDArray[np.int64]

#: A state counts as reachable if it is so within this part of its largest number.
ROUNDING = 1e-9


def play_columns(u: ArrayLike, thresholds: ArrayLike) -> Array:
    """Return the outputs of plays with one input and many thresholds.

    A play with threshold r follows its input like a slider with a gap of r to each side:
    ``p = max(u - r, min(u + r, p before))`` for a monotone input (Krasnosel'skii and Pokrovskii
    1983; Brokate and Sprekels 1996, section 2.1).

    Thresholds [V] are not negative and rise, shape (m,). Outputs are zero before the first sample,
    and have the shape (n, m).

    Notes
    -----
    Validity: every input that is monotone between samples; no rounding beyond one subtraction.

    Examples
    --------
    >>> play_columns([3.0, 1.0, 4.0], [0.5, 2.0])
    array([[2.5, 1. ],
           [1.5, 1. ],
           [3.5, 2. ]])
    """
    r = np.array(thresholds, dtype=np.float64)
    return _columns(np.ascontiguousarray(u, dtype=np.float64), r)


def play_state(state: Array, thresholds: Array) -> Array:
    """Return a state of plays after checking that an input can have led to it.

    Two plays with thresholds r and s on one input are never more than ``|r - s|`` apart, and the
    input itself is the play with threshold zero. So plays start to move in the order of their
    thresholds, on which the stepping relies. State: last input and outputs of the plays [V], shape
    (m + 1,).
    """
    if state.shape != (thresholds.size + 1,) or not np.all(np.isfinite(state)):
        raise ModelError(
            f"a state of {thresholds.size} plays is {thresholds.size + 1} finite numbers, "
            f"got shape {state.shape}: give the last input, then the plays"
        )
    gap = np.diff(thresholds, prepend=0.0)
    excess = np.abs(np.diff(state)) - gap
    allowed = ROUNDING * max(float(np.max(np.abs(state))), float(thresholds[-1]))
    if np.max(excess) > allowed:
        i = int(np.argmax(excess))
        raise ModelError(
            f"no input leads to this state: numbers {i} and {i + 1} of it are "
            f"{abs(state[i + 1] - state[i]):g} apart, and their thresholds allow {gap[i]:g}; "
            f"take a state from a simulation"
        )
    return state


def rising(
    values: ArrayLike, what: str, *, lowest: float = -np.inf, above: float = -np.inf, least: int = 1
) -> Array:
    """Return a finite, strictly rising sequence that can no longer be changed.

    Its first number is at least `lowest` and more than `above`; there are at least `least` of them.
    """
    array = fixed(values, what, (-1,))
    if array.size < least:
        raise ModelError(f"the {what} must be at least {least}, got {array.size}")
    if np.any(np.diff(array) <= 0.0):
        i = int(np.argmax(np.diff(array) <= 0.0))
        raise ModelError(
            f"the {what} must rise, got {array[i]:g} and then {array[i + 1]:g}: "
            f"sort them, and name each once"
        )
    if array.size and (array[0] < lowest or array[0] <= above):
        bound = f"more than {above:g}" if array[0] <= above else f"at least {lowest:g}"
        raise ModelError(f"the {what} must be {bound}, got {array[0]:g}")
    return array


def fixed(values: ArrayLike, what: str, shape: tuple[int, ...]) -> Array:
    """Return finite numbers of a given shape that can no longer be changed.

    A size of -1 in the shape stands for any.
    """
    array = np.array(values, dtype=np.float64, order="C")
    fits = array.ndim == len(shape) and all(
        want in (-1, got) for want, got in zip(shape, array.shape, strict=True)
    )
    if not fits:
        wanted = ", ".join("any" if want < 0 else str(want) for want in shape)
        raise ModelError(f"the {what} must have shape ({wanted}), got {array.shape}")
    if not np.all(np.isfinite(array)):
        raise ModelError(f"the {what} must be finite, got {array[~np.isfinite(array)][0]}")
    array.setflags(write=False)
    return array


@compiled
def _columns(u: Array, thresholds: Array) -> Array:
    """Return the plays for every sample, shape (n, m)."""
    count = thresholds.size
    out = np.empty((u.size, count))
    p = np.zeros(count)
    for n in range(u.size):
        for i in range(count):
            p[i] = max(u[n] - thresholds[i], min(u[n] + thresholds[i], p[i]))
            out[n, i] = p[i]
    return out
