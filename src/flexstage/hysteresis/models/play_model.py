"""Common parts of models that are sums of functions of plays."""

from abc import abstractmethod
from collections.abc import Iterable

import numpy as np
from numpy.typing import ArrayLike

from flexstage.base.errors import ModelError
from flexstage.hysteresis.model import (
    Array,
    HysteresisModel,
    ModelProperty,
    Response,
    Segments,
    sampled,
    samples,
)
from flexstage.hysteresis.models import play_sum
from flexstage.hysteresis.models.play_sum import play_state
from flexstage.hysteresis.models.source_code import (
    HysteresisCode,
    MatlabCode,
    TunableParameter,
    code_of,
    tunable_of,
)

#: Descriptions of a threshold and of a list of thresholds.
THRESHOLD = "half the gap of a play"
_THRESHOLDS = "half the gap of each play [unit of u]"
#: Gain, thresholds, knots, slopes and offsets of a sum of functions of plays.
Sum = tuple[float, Array, Array, Array, Array]


class PlayModel(HysteresisModel):
    """An output ``y = gain u + sum_i f_i(play_i(u))`` with piecewise-linear, rising f_i.

    A state is the last input and the outputs of the plays.
    """

    __slots__ = ()

    @abstractmethod
    def play_terms(self) -> Sum:
        """Return the output as a sum of functions of plays, for kernels and code.

        Returns
        -------
        tuple
            Gain of the input itself, thresholds (m,), inner knots (c,) of the functions, their
            slopes and their offsets (m, c + 1).
        """

    def initial_state(self) -> Array:
        return np.zeros(self.play_terms()[1].size + 1)

    def simulate(self, u: ArrayLike, state: ArrayLike | None = None) -> Response:
        after = self._state(state)
        y = play_sum.simulate(samples(u, "input"), *self.play_terms(), after)
        return Response(values=y, state=after)

    def inverse(self, y: ArrayLike, state: ArrayLike | None = None) -> Response:
        # where the output is constant over a range of inputs, the input stops at its near end
        hint = "its outermost slopes are zero; stay within its outputs"
        return self._reaching(y, state, f"of this {self.kind} model", hint)

    def nearest(self, y: ArrayLike, state: ArrayLike | None = None) -> Response:
        after = self._state(state)
        outputs = samples(y, "output")
        if (least := least_slope(self.play_terms())) < 0.0:
            raise ModelError(
                f"this {self.kind} model has no inverse, since its slope can be "
                f"{least:g}: identify it with weights that are not negative"
            )
        u, missed = play_sum.invert(outputs, *self.play_terms(), after)
        return Response(values=u, state=after, missed=missed)

    def segments(self, u: ArrayLike, state: ArrayLike | None = None) -> Segments:
        inputs = sampled(u)
        first = self.simulate(inputs[:1], state)
        return segments_of(inputs, self.play_terms(), first.state, backward=False)

    def properties(self) -> tuple[ModelProperty, ...]:
        # The energy of a closed cycle, integral u dy, is that of the plays, sum of r_i integral
        # f_i'(p_i) |dp_i| (Brokate and Sprekels 1996, section 2.4), so slopes that are not negative
        # make it so. The inverse is unique if the slope is positive everywhere.
        gain, thresholds, _, slopes, _ = self.play_terms()
        steepest = abs(gain) + float(np.sum(np.max(np.abs(slopes), axis=1)))
        lossy = slopes[thresholds > 0.0]
        lowest = float(np.min(lossy)) if lossy.size else 0.0
        least = least_slope(self.play_terms())
        return (
            ModelProperty(
                name="bounded",
                holds=True,
                detail=f"the output is never more than {steepest:g} times the largest input",
            ),
            ModelProperty(
                name="dissipative",
                holds=lowest >= 0.0,
                detail=f"every weight of a play is at least 0, the least is {lowest:g}; "
                f"else a cycle can give out energy",
            ),
            ModelProperty(
                name="invertible",
                holds=least > 0.0,
                detail=f"the slope is more than 0 everywhere, it is at least {least:g}; "
                f"else an output can belong to several inputs",
            ),
        )

    def _state(self, state: ArrayLike | None) -> Array:
        checked_copy = super()._state(state)
        return checked_copy if state is None else play_state(checked_copy, self.play_terms()[1])


def terms(gain: float, thresholds: Array, knots: Array, slopes: Array) -> Sum:
    """Return a sum of functions of plays as the kernels take it.

    The gain is that of the input itself. The arrays are copies: kernels would be compiled again for
    arrays that cannot be written.
    """
    r, k, s = np.array(thresholds), np.array(knots), np.array(slopes, order="C")
    return gain, r, k, s, play_sum.offsets_of(k, s)


def least_slope(total: Sum) -> float:
    """Return a lower bound of the slope of a sum of functions of plays, whatever its memory.

    Only the first few plays move, each at its flattest; one with threshold zero always moves. It is
    the least slope itself if there are no knots.
    """
    gain, thresholds, _, slopes, _ = total
    sums = gain + np.cumsum(np.min(slopes, axis=1))
    return float(np.min(sums if thresholds[0] == 0.0 else np.append(sums, gain)))


def segments_of(values: Array, terms: Sum, state: Array, *, backward: bool) -> Segments:
    """Return the straight pieces of a sum of functions of plays, or of its inverse.

    Backward, the samples are of the sum and the pieces of the input of the plays. The state is last
    input of the plays, and the plays, at the first sample; that of the pieces is theirs too.
    """
    room = np.empty((4 * values.size, 3))
    after = state.copy()
    count = play_sum.pieces(values, backward, *terms, after, room)
    if count > room.shape[0]:
        room = np.empty((count, 3))
        after = state.copy()
        play_sum.pieces(values, backward, *terms, after, room)
    start, constant, slope = np.ascontiguousarray(room[:count].T)
    return Segments.straight(start, constant, slope, values.size, after)


def sum_numbers(total: Sum) -> Array:
    """Return a sum of functions of plays as C takes it."""
    gain, thresholds, knots, slopes, offsets = total
    sizes = [thresholds.size, knots.size, gain]
    return np.concatenate([sizes, thresholds, knots, slopes.ravel(), offsets.ravel()])


def largest_pieces(total: Sum) -> int:
    """Return the largest number of pieces: each play may start, and pass each knot."""
    return total[1].size * (total[2].size + 1) + 1


def play_parameters(model: HysteresisModel, thresholds: Array) -> list[TunableParameter]:
    """Return gain, thresholds and weights; the weights stand after the thresholds.

    Thresholds cannot be changed, since the memory belongs to them.
    """
    m = thresholds.size
    return [
        tunable_of(model, "gain", 2, "slope just after the voltage turns back"),
        *elements(model, "thresholds", thresholds, THRESHOLD),
        *(tunable_of(model, f"weights[{i}]", 3 + m + i, "weight of a play") for i in range(m)),
    ]


def elements(
    model: HysteresisModel, name: str, values: Array, description: str
) -> Iterable[TunableParameter]:
    """Return the elements of a list that cannot be changed."""
    return [tunable_of(model, f"{name}[{i}]", None, description) for i in range(values.size)]


def plays_c_code(model: PlayModel, tunable: Iterable[TunableParameter]) -> HysteresisCode:
    """Return the code in C of a sum of functions of plays."""
    total = model.play_terms()
    return code_of(model, sum_numbers(total), tunable, largest_pieces(total), "plays.h")


def plays_matlab_code(model: PlayModel) -> MatlabCode:
    """Return the code in MATLAB of a sum of functions of plays."""
    line = play_sum.PiecewiseLinear(knots=np.zeros(0), slopes=np.ones(1))
    return plays_and_line_matlab_code(model.play_terms(), line)


def plays_and_line_matlab_code(total: Sum, line: play_sum.PiecewiseLinear) -> MatlabCode:
    """Return the code in MATLAB of a sum of functions of plays, and of a line after it."""
    gain, thresholds, inner, by_play, constants = total
    numbers = {
        "gain": (gain, "part of the input itself [unit of y per unit of u]"),
        "thresholds": (thresholds, _THRESHOLDS),
        "knots": (inner, "where the functions of the plays change their slope [unit of u]"),
        "slopes": (by_play, "slopes of these functions, one row a play [unit of y per unit of u]"),
        "offsets": (constants, "their values at zero, continued from each interval [unit of y]"),
        "line_knots": (line.knots, "where the line after them has kinks"),
        "line_slopes": (line.slopes, "slopes of this line [1]"),
        "line_offsets": (line.offsets(), "its values at zero"),
    }
    return MatlabCode(parts=("plays",), parameters=numbers)
