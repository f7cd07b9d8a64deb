"""Measured frequency response with its variance and coherence, also from a record."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from flexstage.base.arrays import Array, Complex
from flexstage.base.errors import RecordError
from flexstage.base.short_repr import short_repr
from flexstage.records import Record

_PARTS = (" real", " imaginary")
_RESPONSES = ("frequency response function", "transmissibility")
_COHERENCE, _VARIANCE, _BLUR = "coherence ", "variance ", "blur "


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MeasuredResponse:
    """Frequency response functions from measured inputs to measured outputs.

    Raises
    ------
    RecordError
        The shapes do not match, the frequencies do not rise, or a value is not finite.
    """

    frequency_hz: Array
    """Frequencies, rising [Hz], shape (k,)."""
    response: Complex
    """Output over input, in their units, shape (k, outputs, inputs)."""
    inputs: tuple[str, ...]
    """Names of the inputs."""
    outputs: tuple[str, ...]
    """Names of the outputs."""
    input_units: tuple[str, ...] = ()
    """SI units of the inputs, empty if unknown."""
    output_units: tuple[str, ...] = ()
    """SI units of the outputs, empty if unknown; ``m``, ``m/s`` or ``m/s^2`` distinguishes
    displacement, velocity and acceleration.
    """
    variance: Array | None = None
    """Expected square of the error of each complex value, real and imaginary part together, shape
    (k, outputs, inputs); None if unknown, as for a single average.
    """
    coherence: Array | None = None
    """Share of the power of each output that the inputs explain together [1], shape (k, outputs).
    """
    averages: float = 0.0
    """Number of independent averages of each value; 0 if unknown."""
    estimator: str = ""
    """``H1``, ``H2`` or ``Hv``; empty if unknown."""
    source: str = ""
    """Source of the response."""
    notes: tuple[str, ...] = ()
    """Remarks on the response."""
    blur: float = 0.0
    """Smearing of neighbouring lines by a window: second moment of its kernel, in squares of the
    line spacing [1]. 1/3 for a Hann window on noise, 0 for full periods and transients.
    """
    rate_uncertainty: float = 0.0
    """Relative standard uncertainty of the sample rate [1], common to all frequencies."""

    __repr__ = short_repr

    def __post_init__(self) -> None:
        f = self.frequency_hz
        shape = (f.size, len(self.outputs), len(self.inputs))
        if f.ndim != 1 or f.size < 2 or not np.all(np.diff(f) > 0.0) or f[0] < 0.0:
            raise RecordError(
                "a response needs at least two frequencies of 0 or more, in rising order"
            )
        for name, array, required in (
            ("response", self.response, shape),
            ("variance", self.variance, shape),
            ("coherence", self.coherence, shape[:2]),
        ):
            if array is not None and array.shape != required:
                raise RecordError(f"the {name} must have shape {required}, got {array.shape}")
        if not np.isfinite(self.response).all():
            raise RecordError("a frequency response must be finite at all of its frequencies")

    def between(self, low_hz: float, high_hz: float) -> "MeasuredResponse":
        """Return the part of the response between two frequencies [Hz], both within.

        Raises
        ------
        RecordError
            Fewer than two frequencies are in the band.
        """
        inside = (self.frequency_hz >= low_hz) & (self.frequency_hz <= high_hz)
        if inside.sum() < 2:
            raise RecordError(
                f"there are {int(inside.sum())} frequencies from {low_hz:g} to {high_hz:g} Hz in a "
                f"response from {self.frequency_hz[0]:g} to {self.frequency_hz[-1]:g} Hz: widen "
                "the band, or use longer segments"
            )
        return self.lines(inside)

    def lines(self, mask: NDArray[np.bool_]) -> "MeasuredResponse":
        """Return the response at the frequencies of a mask of shape (k,)."""
        return replace(
            self,
            frequency_hz=self.frequency_hz[mask],
            response=self.response[mask],
            variance=None if self.variance is None else self.variance[mask],
            coherence=None if self.coherence is None else self.coherence[mask],
        )


def response_from_record(record: Record) -> MeasuredResponse:
    """Return the frequency responses of a record over frequency, as of a universal file.

    A function has two columns, ``NAME real`` and ``NAME imaginary``, with NAME of the form
    ``OUTPUT/INPUT``; attributes ``output of NAME``, ``input of NAME``, ``output unit of NAME`` and
    ``input unit of NAME`` take precedence over the name. A column ``coherence NAME`` is the
    coherence, if there is one input; ``variance NAME`` and ``blur NAME`` are those fields of the
    response.

    Parameters
    ----------
    record : Record
        The record.

    Returns
    -------
    MeasuredResponse
        The responses of every output to every input.

    Validity
    --------
    Values and units are those of the record.

    Raises
    ------
    RecordError
        The record is not over frequency, or lacks the response of one of its outputs to one of its
        inputs.

    Examples
    --------
    >>> from flexstage.records import Channel
    >>> f = np.array([10.0, 12.0, 14.0])
    >>> h = 2e-6 / (1.0 + 1j * f / 70.0)
    >>> columns = (
    ...     Channel(name="2:+x/1:+x real", values=h.real, unit="m/N"),
    ...     Channel(name="2:+x/1:+x imaginary", values=h.imag, unit="m/N"),
    ... )
    >>> response = response_from_record(Record(channels=columns, time=f, over="frequency"))
    >>> response.outputs, response.inputs, f"{abs(response.response[0, 0, 0]):.3e}"
    (('2:+x',), ('1:+x',), '1.980e-06')
    """
    if record.over != "frequency":
        raise RecordError(
            f"a frequency response needs a record over frequency, got one over {record.over}: "
            "estimate it with estimate_response"
        )
    names = _functions(record)
    if not names:
        raise RecordError(
            "the record contains no frequency response: it needs columns 'NAME real' and 'NAME "
            f"imaginary', got {', '.join(c.name for c in record.channels[:10])}"
        )
    ends = {name: _ends(record, name) for name in names}
    outputs = tuple(dict.fromkeys(out for out, _ in ends.values()))
    inputs = tuple(dict.fromkeys(into for _, into in ends.values()))
    at = {pair: name for name, pair in ends.items()}
    if len(at) < len(names):
        twice = next(name for name in names if at[ends[name]] != name)
        raise RecordError(
            f"'{twice}' and '{at[ends[twice]]}' are the same response: remove one from the file"
        )
    response = np.empty((record.size, len(outputs), len(inputs)), dtype=np.complex128)
    for o, out in enumerate(outputs):
        for i, into in enumerate(inputs):
            if (out, into) not in at:
                raise RecordError(
                    f"the response of '{out}' to '{into}' is missing, though both occur in others: "
                    "the file must have every output with every input"
                )
            parts = [record.channel(at[out, into] + part).values for part in _PARTS]
            response[:, o, i] = parts[0] + 1j * parts[1]
    coherence = _coherence(record, [at[out, inputs[0]] for out in outputs], len(inputs))
    variance = None
    have = {c.name: c.values for c in record.channels}
    if all(_VARIANCE + name in have for name in names):
        each = [[have[_VARIANCE + at[out, into]] for into in inputs] for out in outputs]
        variance = np.moveaxis(np.array(each), 2, 0)
    return MeasuredResponse(
        frequency_hz=record.time,
        response=response,
        inputs=inputs,
        outputs=outputs,
        input_units=_units(record, "input", [at[outputs[0], into] for into in inputs]),
        output_units=_units(record, "output", [at[out, inputs[0]] for out in outputs]),
        variance=variance,
        coherence=coherence,
        source=record.source,
        notes=record.notes,
        blur=_blur(record, names),
    )


def _functions(record: Record) -> list[str]:
    have = {c.name for c in record.channels}
    names = [c.name.removesuffix(_PARTS[0]) for c in record.channels if c.name.endswith(_PARTS[0])]
    pairs = [n for n in names if n + _PARTS[1] in have]
    return [n for n in pairs if record.attributes.get(f"kind of {n}", _RESPONSES[0]) in _RESPONSES]


def _ends(record: Record, name: str) -> tuple[str, str]:
    """Output and input of a function."""
    out, _, into = name.partition("/")
    get = record.attributes.get
    return get(f"output of {name}", out), get(f"input of {name}", into or "input")


def _units(record: Record, which: str, names: list[str]) -> tuple[str, ...]:
    return tuple(record.attributes.get(f"{which} unit of {name}", "") for name in names)


def _blur(record: Record, names: list[str]) -> float:
    """Return the smearing of neighbouring lines, if it is equal for all responses."""
    have = {c.name: c.values for c in record.channels}
    blurs = [have[_BLUR + name] for name in names if _BLUR + name in have]
    return float(blurs[0][0]) if blurs and np.ptp(np.concatenate(blurs)) == 0.0 else 0.0


def _coherence(record: Record, names: list[str], inputs: int) -> Array | None:
    have = {c.name: c.values for c in record.channels}
    columns = [_COHERENCE + name for name in names]
    if inputs > 1 or any(name not in have for name in columns):
        return None
    return np.stack([have[name] for name in columns], axis=1)
