"""A measured frequency response: estimates, how far they can be trusted, and what they relate."""

from dataclasses import dataclass

import numpy as np

from flexstage.arrays import Array, Complex
from flexstage.errors import RecordError
from flexstage.short_repr import short_repr


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MeasuredResponse:
    """Frequency response functions from measured inputs to measured outputs.

    Raises
    ------
    RecordError
        The shapes do not belong together, the frequencies do not rise, or a value is not finite.
    """

    frequency_hz: Array
    """Frequencies, rising [Hz], shape (k,)."""
    response: Complex
    """Output over input, in their units, shape (k, outputs, inputs)."""
    inputs: tuple[str, ...]
    """What the inputs are called."""
    outputs: tuple[str, ...]
    """What the outputs are called."""
    input_units: tuple[str, ...] = ()
    """SI units of the inputs, empty where nobody has said."""
    output_units: tuple[str, ...] = ()
    """SI units of the outputs, empty where nobody has said; ``m``, ``m/s`` or ``m/s^2`` tells
    displacement from velocity and acceleration.
    """
    variance: Array | None = None
    """Expected square of the error of each complex value, real and imaginary part together, shape
    (k, outputs, inputs); None where it is not known, as of a single average.
    """
    coherence: Array | None = None
    """Share of the power of each output that the inputs explain together [1], shape (k, outputs).
    """
    averages: float = 0.0
    """Number of independent averages behind each value; 1 where there is one, 0 where nobody has
    said.
    """
    estimator: str = ""
    """``H1``, ``H2`` or ``Hv``; empty where nobody has said."""
    source: str = ""
    """Where it comes from."""
    notes: tuple[str, ...] = ()
    """What a reader should know."""
    blur: float = 0.0
    """By how much a window has mixed neighbouring lines: second moment of its kernel, in squares of
    their distance [1]. 1/3 of a Hann window on noise, 0 of whole periods and of transients.
    """
    rate_uncertainty: float = 0.0
    """Standard uncertainty of the sample rate over it [1], which all frequencies share."""

    __repr__ = short_repr

    def __post_init__(self) -> None:
        f = self.frequency_hz
        shape = (f.size, len(self.outputs), len(self.inputs))
        if f.ndim != 1 or f.size < 2 or not np.all(np.diff(f) > 0.0) or f[0] < 0.0:
            raise RecordError("the frequencies of a response must be at least two, 0 or more, rise")
        for name, array, wanted in (
            ("response", self.response, shape),
            ("variance", self.variance, shape),
            ("coherence", self.coherence, shape[:2]),
        ):
            if array is not None and array.shape != wanted:
                raise RecordError(f"the {name} must have shape {wanted}, got {array.shape}")
        if not np.isfinite(self.response).all():
            raise RecordError("a frequency response must be finite at all of its frequencies")

    def between(self, low_hz: float, high_hz: float) -> "MeasuredResponse":
        """Return the part of the response in a band.

        Parameters
        ----------
        low_hz, high_hz : float
            Ends of the band, both within [Hz].

        Returns
        -------
        MeasuredResponse
            The part.

        Raises
        ------
        RecordError
            Fewer than two frequencies are in the band.
        """
        from dataclasses import replace

        inside = (self.frequency_hz >= low_hz) & (self.frequency_hz <= high_hz)
        if inside.sum() < 2:
            raise RecordError(
                f"there are {int(inside.sum())} frequencies from {low_hz:g} to {high_hz:g} Hz in a "
                f"response from {self.frequency_hz[0]:g} to {self.frequency_hz[-1]:g} Hz: widen "
                "the band, or use longer segments"
            )
        return replace(
            self,
            frequency_hz=self.frequency_hz[inside],
            response=self.response[inside],
            variance=None if self.variance is None else self.variance[inside],
            coherence=None if self.coherence is None else self.coherence[inside],
        )
