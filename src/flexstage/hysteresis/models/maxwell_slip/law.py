"""The generalised Maxwell-slip model: springs and dry sliders that the displacement drives."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from flexstage.base.errors import ModelError
from flexstage.hysteresis.model import (
    Array,
    HysteresisModel,
    ModelProperty,
    Response,
    Segments,
    checked,
    fixed,
    rising,
    sampled,
    samples,
)
from flexstage.hysteresis.models import play_sum
from flexstage.hysteresis.models.play_model import (
    Sum,
    elements,
    largest_pieces,
    least_slope,
    segments_of,
    sum_numbers,
    terms,
)
from flexstage.hysteresis.models.play_sum import (
    STATE_ROUNDING,
    PiecewiseLinear,
    dead_zone_line,
    dead_zones,
    play_state,
)
from flexstage.hysteresis.models.source_code import HysteresisCode, MatlabCode, code_of, tunable_of


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class GeneralisedMaxwellSlip(HysteresisModel):
    """Generalised Maxwell-slip model from voltage to displacement.

    ``u = stiffness y + s(y) + sum_i k_i stop_i(y)``: the voltage that a displacement needs is that
    of a spring and of elastic sliders in parallel, each of which slides from the displacement
    ``r_i`` on (Goldfarb and Celanovic 1997, IEEE Control Syst. Mag. 17(3):69). A spring without
    memory, ``s(y) = sum_k v_k max(y - d_k, 0)`` for positive and ``min(y - d_k, 0)`` for negative
    dead zones d_k, makes it bend. The displacement for a voltage is the exact inverse of this.

    Notes
    -----
    Validity: rate-independent hysteresis with wiping-out (a minor loop that closes leaves no
    trace). Minor loops between the same two *displacements* have the same width in voltage.
    Without dead zones it is a Prandtl-Ishlinskii model in other parameters, with symmetric loops;
    with them the loop bends, but gets no wider or narrower with the bias. Creep is beyond it.
    State: last voltage, displacement, and the displacements of the m sliders.

    Raises
    ------
    ModelError
        Shapes do not match, a number is not finite, thresholds or dead zones do not rise, or the
        voltage does not always rise with the displacement.

    Examples
    --------
    >>> model = GeneralisedMaxwellSlip(
    ...     stiffness=1.5e6, thresholds=np.array([2e-6, 6e-6]),
    ...     element_stiffness=np.array([0.4e6, 0.3e6]),
    ... )
    >>> model.simulate([90.0, 20.0]).values * 1e6
    array([58.26666667, 15.06666667])
    """

    kind: ClassVar[str] = "maxwell-slip"
    title: ClassVar[str] = "generalised Maxwell-slip"
    units: ClassVar[Mapping[str, str]] = {
        "stiffness": "{u}/{y}",
        "thresholds": "{y}",
        "element_stiffness": "{u}/{y}",
        "dead_zones": "{y}",
        "dead_zone_weights": "{u}/{y}",
    }

    stiffness: float
    """Slope of the spring that never slides [V/m]."""
    thresholds: Array
    """Displacement from which each element slides [m], positive and rising, shape (m,)."""
    element_stiffness: Array
    """Slope of each element before it slides [V/m], shape (m,); not negative for loops that take in
    energy.
    """
    dead_zones: Array = field(default_factory=lambda: np.empty(0))
    """Where the slope of the bent spring changes [m], rising, none zero, shape (l,)."""
    dead_zone_weights: Array = field(default_factory=lambda: np.empty(0))
    """By how much it changes there, away from zero [V/m], shape (l,)."""

    def __post_init__(self) -> None:
        r = rising(self.thresholds, "thresholds of elements", above=0.0)
        k = fixed(self.element_stiffness, "stiffnesses of elements", r.shape)
        d, v = dead_zones(self.dead_zones, self.dead_zone_weights)
        self._set(thresholds=r, element_stiffness=k, dead_zones=d, dead_zone_weights=v)
        self._set(stiffness=checked(self.stiffness, "stiffness"))
        least = least_slope(self.play_terms())
        if least <= 0.0:
            raise ModelError(
                f"the voltage must rise with the displacement everywhere, got a slope of "
                f"{least:g} V/m: raise the stiffness, or weaken dead zones with negative weights"
            )

    def play_terms(self) -> Sum:
        """Return the voltage as a sum of functions of plays of the displacement.

        A stop is its input less a play; the bent spring is a function of a play without a gap.

        Returns
        -------
        tuple
            Gain, thresholds, knots, slopes and offsets, as of `PrandtlIshlinskii.play_terms`.
        """
        line = self.spring()
        slopes = np.empty((self.thresholds.size + 1, line.slopes.size))
        slopes[0] = line.slopes
        slopes[1:] = -self.element_stiffness[:, None]
        thresholds = np.append(0.0, self.thresholds)
        return terms(float(np.sum(self.element_stiffness)), thresholds, line.knots, slopes)

    def spring(self) -> PiecewiseLinear:
        """Return the voltage of the spring that never slides, straight and bent part together.

        Returns
        -------
        PiecewiseLinear
            Voltage [V] of displacement [m].
        """
        return dead_zone_line(self.stiffness, self.dead_zones, self.dead_zone_weights)

    def initial_state(self) -> Array:
        return np.zeros(self.thresholds.size + 2)

    def simulate(self, u: ArrayLike, state: ArrayLike | None = None) -> Response:
        inputs = samples(u, "input")
        plays = _inner(self._state(state))
        y, _ = play_sum.invert(inputs, *self.play_terms(), plays)
        return Response(values=y, state=_outer(inputs[-1], plays))

    def inverse(self, y: ArrayLike, state: ArrayLike | None = None) -> Response:
        outputs = samples(y, "output")
        plays = _inner(self._state(state))
        u = play_sum.simulate(outputs, *self.play_terms(), plays)
        return Response(values=u, state=_outer(u[-1], plays))

    def segments(self, u: ArrayLike, state: ArrayLike | None = None) -> Segments:
        inputs = sampled(u)
        first = self.simulate(inputs[:1], state)
        pieces = segments_of(inputs, self.play_terms(), _inner(first.state), backward=True)
        return replace(pieces, state=_outer(inputs[-1], pieces.state))

    def properties(self) -> tuple[ModelProperty, ...]:
        # a closed cycle takes in the work of the sliders: sum of k_i r_i times the way that slider
        # i goes
        least = least_slope(self.play_terms())
        weakest = float(np.min(self.element_stiffness))
        return (
            ModelProperty(
                name="bounded",
                holds=True,
                detail=f"the displacement is never more than {1.0 / least:g} m per volt of the "
                f"largest voltage",
            ),
            ModelProperty(
                name="dissipative",
                holds=weakest >= 0.0,
                detail=f"the stiffness of every element is at least 0, the least is {weakest:g}; "
                f"else a cycle can give out energy",
            ),
            ModelProperty(
                name="invertible",
                holds=True,
                detail="the voltage is given by the displacement, as the model is written",
            ),
        )

    def _state(self, state: ArrayLike | None) -> Array:
        checked_copy = HysteresisModel._state(self, state)
        if state is None:
            return checked_copy
        play_state(checked_copy[1:], self.thresholds)
        u = play_sum.simulate(checked_copy[1:2], *self.play_terms(), _inner(checked_copy))[0]
        steepest = self.play_terms()[0] + float(np.max(np.abs(self.spring().slopes)))
        # rounding is that of the ways that led here, not only of where they ended: at no voltage
        # the state may be small, and the thresholds are not
        reach = max(float(np.max(np.abs(checked_copy[1:]))), float(self.thresholds[-1]))
        scale = max(abs(checked_copy[0]), steepest * reach)
        if abs(u - checked_copy[0]) > STATE_ROUNDING * scale:
            raise ModelError(
                f"no voltage leads to this state: its displacements belong to {u:g}, and its "
                f"first number is {checked_copy[0]:g}; take a state from a simulation"
            )
        return checked_copy


def _inner(state: Array) -> Array:
    """Return the state of the plays: displacement, the play without a gap, the sliders."""
    return np.concatenate([state[1:2], state[1:]])


def _outer(u: float, plays: Array) -> Array:
    """Return the state of the model: voltage, displacement, sliders."""
    return np.concatenate([[u], plays[1:]])


def c_code(model: GeneralisedMaxwellSlip) -> HysteresisCode:
    """Return the code in C, all fixed: the state must fit to every parameter."""
    total, sliders, zones = model.play_terms(), model.thresholds, model.dead_zones
    tunable = [
        tunable_of(model, "stiffness", None, "stiffness of the spring that never slides"),
        *elements(model, "thresholds", sliders, "displacement from which an element slides"),
        *elements(model, "element_stiffness", sliders, "stiffness of an element before it slides"),
        *elements(model, "dead_zones", zones, "where the stiffness of the spring changes"),
        *elements(model, "dead_zone_weights", zones, "by how much it changes there"),
    ]
    return code_of(model, sum_numbers(total), tunable, largest_pieces(total))


def matlab_code(model: GeneralisedMaxwellSlip) -> MatlabCode:
    """Return the code in MATLAB."""
    gain, thresholds, knots, slopes, offsets = model.play_terms()
    numbers = {
        "gain": (gain, "slope of all elements together [V/m]"),
        "thresholds": (thresholds, "displacement from which each element slides [m]"),
        "knots": (knots, "where the bent spring changes its slope [m]"),
        "slopes": (slopes, "slopes of the bent spring, and of the elements, negative [V/m]"),
        "offsets": (offsets, "their values at zero, continued from each interval [V]"),
    }
    return MatlabCode(parts=("maxwell_slip",), parameters=numbers)
