"""Base class of the hysteresis models: frozen parameters, an explicit state, one step."""

import dataclasses
import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from flexstage.base.arrays import Array
from flexstage.base.errors import ModelError


@dataclass(frozen=True, slots=True, kw_only=True)
class ModelProperty:
    """Property of a model, by a condition on its parameters."""

    name: str
    """Name of the property: ``invertible``, ``dissipative``, ``bounded``..."""
    holds: bool
    """True if the condition is satisfied."""
    detail: str
    """The condition with its numbers, and the consequence if it is not satisfied."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Response:
    """Response of a model to a sequence."""

    values: Array
    """Output of a simulation, or input found by an inverse, shape (n,)."""
    state: Array
    """State after the last sample."""
    missed: int = -1
    """First sample out of reach of the inputs; -1 for none."""


class SegmentArrays(NamedTuple):
    """Arrays of `Segments`, one argument of compiled loops; shape (m,) each."""

    start: Array
    constant: Array
    slope: Array
    amplitude: Array
    rate: Array


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Segments:
    """An output in closed form between the samples, for an input of straight lines.

    On segment i, with s counted from its start in samples, the output is
    ``constant + slope s + amplitude exp(-rate s)``.
    """

    start: Array
    """Where each segment starts [samples], rising from 0, shape (m,). A segment ends where the next
    one starts; the last one ends at the last sample.
    """
    constant: Array
    """Constants, shape (m,)."""
    slope: Array
    """Slopes [per sample], shape (m,)."""
    amplitude: Array
    """Amplitudes of the exponentials, shape (m,); zero for models that are piecewise linear."""
    rate: Array
    """Rates of the exponentials [per sample], shape (m,)."""
    samples: int
    """Number of samples n of the input."""
    state: Array
    """State after the last sample."""

    @classmethod
    def straight(
        cls, start: Array, constant: Array, slope: Array, samples: int, state: Array
    ) -> "Segments":
        """Return segments without an exponential part."""
        none = np.zeros(start.size)
        return cls(
            start=start,
            constant=constant,
            slope=slope,
            amplitude=none,
            rate=none,
            samples=samples,
            state=state,
        )

    @property
    def arrays(self) -> SegmentArrays:
        """The arrays, as compiled loops take them."""
        return SegmentArrays(self.start, self.constant, self.slope, self.amplitude, self.rate)


class HysteresisModel(ABC):
    """A rate-independent relation with memory from an input u to an output y.

    A model is a frozen dataclass of parameters. Its state is an array, whose first element is the
    last input. The input is a straight line between samples, and the output is exact for it: it
    does not depend on the division of the line into steps.

    The output at zero input without history is zero; an offset belongs to the sensor.
    """

    __slots__ = ()

    #: Name of the model in files and on the command line.
    kind: ClassVar[str]
    #: Name of the model in text.
    title: ClassVar[str]
    #: Units of the parameters that have one, from the units {u} of the input and {y} of the output;
    #: of a model with an exponent those for 1.
    units: ClassVar[Mapping[str, str]]

    @abstractmethod
    def initial_state(self) -> Array:
        """Return the state without history, at zero input.

        Returns
        -------
        numpy.ndarray
            The state; its first element is the last input, zero.
        """

    @abstractmethod
    def simulate(self, u: ArrayLike, state: ArrayLike | None = None) -> Response:
        """Return the output for a sequence of inputs.

        Parameters
        ----------
        u : array_like
            Inputs, shape (n,).
        state : array_like, optional
            State before the first of them; `initial_state` where not given. The first step leads
            from its last input to ``u[0]``.

        Returns
        -------
        Response
            The outputs, and the state after the last input.

        Raises
        ------
        ModelError
            The input is no finite sequence, or the state does not belong to this model.
        """

    @abstractmethod
    def inverse(self, y: ArrayLike, state: ArrayLike | None = None) -> Response:
        """Return the input that gives a sequence of outputs.

        Parameters
        ----------
        y : array_like
            Outputs, shape (n,).
        state : array_like, optional
            State before the first of them; `initial_state` where not given.

        Returns
        -------
        Response
            The inputs, and the state after the last of them.

        Raises
        ------
        ModelError
            The output is no finite sequence, is out of reach of the model, or the model cannot be
            inverted.
        """

    def nearest(self, y: ArrayLike, state: ArrayLike | None = None) -> Response:
        """Return the input whose output comes nearest to a sequence of outputs.

        Parameters
        ----------
        y : array_like
            Outputs, shape (n,).
        state : array_like, optional
            State before the first of them; `initial_state` where not given.

        Returns
        -------
        Response
            As by `inverse`; if an output is out of reach, the input stops at the end.

        Raises
        ------
        ModelError
            The output is no finite sequence, or the model cannot be inverted.
        """
        return self.inverse(y, state)

    @abstractmethod
    def properties(self) -> tuple[ModelProperty, ...]:
        """Return the conditions on the parameters, and whether they are satisfied.

        Returns
        -------
        tuple of ModelProperty
            Conditions for bounded output, passivity (no gain of energy in a cycle) and
            invertibility.
        """

    def step(self, state: ArrayLike, u: float) -> tuple[Array, float]:
        """Move the input on a straight line to a new value.

        Parameters
        ----------
        state : array_like
            The state before.
        u : float
            The new input.

        Returns
        -------
        tuple of numpy.ndarray and float
            The state after, and the output.
        """
        response = self.simulate(np.array([u], dtype=np.float64), state)
        return response.state, float(response.values[0])

    def segments(self, u: ArrayLike, state: ArrayLike | None = None) -> Segments | None:
        """Return the output between the samples in closed form.

        Parameters
        ----------
        u : array_like
            Inputs, shape (n,), n at least 2.
        state : array_like, optional
            State before the first of them; `initial_state` where not given.

        Returns
        -------
        Segments or None
            The pieces from the first to the last sample; None where the model has no such form.
        """
        del u, state
        return None

    @property
    def input_limits(self) -> tuple[float, float] | None:
        """Lowest and highest valid input of the model; None if unlimited."""
        return None

    def parameters(self) -> dict[str, object]:
        """Return the parameters by name.

        Returns
        -------
        dict
            Every field of the model.
        """
        return {f.name: getattr(self, f.name) for f in dataclasses.fields(self)}  # type: ignore[arg-type]

    def _set(self, **fields: object) -> None:
        """Set fields to their checked values, as a frozen dataclass is made."""
        for name, value in fields.items():
            object.__setattr__(self, name, value)

    def _reaching(self, y: ArrayLike, state: ArrayLike | None, where: str, hint: str) -> Response:
        """Return the nearest inputs after checking that they give the outputs."""
        response = self.nearest(y, state)
        if response.missed >= 0:
            raise ModelError(
                f"no input {where} gives {samples(y, 'output')[response.missed]:g}, requested at "
                f"sample {response.missed}: {hint}"
            )
        return response

    def _state(self, state: ArrayLike | None) -> Array:
        """Return a private copy of a state after checking that it is one of this model."""
        initial = self.initial_state()
        if state is None:
            return initial
        copy = np.array(state, dtype=np.float64)
        if copy.shape != initial.shape or not np.all(np.isfinite(copy)):
            raise ModelError(
                f"a state of {self.kind} is {initial.size} finite numbers, got shape {copy.shape}"
            )
        return copy


#: Kinds of finite numbers, in the words of the error message.
_NUMBERS: Mapping[str, Callable[[float], bool]] = {
    "finite": lambda value: True,
    "finite, not 0": lambda value: value != 0.0,
    "finite and not negative": lambda value: value >= 0.0,
    "positive and finite": lambda value: value > 0.0,
}


def checked(value: float, what: str, kind: str = "finite", unit: str = "") -> float:
    """Return a number after checking that it is finite, and of a kind such as "finite, not 0".

    Examples
    --------
    >>> checked(2, "rate", "positive and finite", "Hz")
    2.0
    """
    if not (math.isfinite(value) and _NUMBERS[kind](value)):
        raise ModelError(f"the {what} must be {kind}, got {value} {unit}".rstrip())
    return float(value)


def samples(values: ArrayLike, what: str) -> Array:
    """Return a sequence of finite numbers."""
    array = np.ascontiguousarray(values, dtype=np.float64)
    if array.ndim != 1 or array.size == 0:
        raise ModelError(f"the {what} must be a sequence of numbers, got shape {array.shape}")
    bad = np.flatnonzero(~np.isfinite(array))
    if bad.size:
        raise ModelError(
            f"the {what} must be finite, got {array[bad[0]]} at sample {bad[0]}: correct the record"
        )
    return array


def sampled(u: ArrayLike) -> Array:
    """Return a sequence of at least two finite inputs."""
    inputs = samples(u, "input")
    if inputs.size < 2:
        raise ModelError(
            "a motion between samples needs at least two of them, got 1: give a longer input"
        )
    return inputs


def rising(
    values: ArrayLike, what: str, *, lowest: float = -np.inf, above: float = -np.inf, least: int = 1
) -> Array:
    """Return a finite, strictly rising, read-only sequence after checking it.

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
    """Return finite, read-only numbers of a given shape after checking them.

    A size of -1 in the shape is any size.
    """
    array = np.array(values, dtype=np.float64, order="C")
    fits = array.ndim == len(shape) and all(
        want in (-1, got) for want, got in zip(shape, array.shape, strict=True)
    )
    if not fits:
        expected = ", ".join("any" if want < 0 else str(want) for want in shape)
        raise ModelError(f"the {what} must have shape ({expected}), got {array.shape}")
    if not np.all(np.isfinite(array)):
        raise ModelError(f"the {what} must be finite, got {array[~np.isfinite(array)][0]}")
    array.setflags(write=False)
    return array
