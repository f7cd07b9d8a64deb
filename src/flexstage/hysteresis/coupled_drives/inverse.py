"""Commands by which coupled drives follow references of all their sensors."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from flexstage.base.arrays import Array
from flexstage.base.errors import ModelError
from flexstage.files.plain import picked
from flexstage.files.result import Result
from flexstage.hysteresis.coupled_drives.model import CoupledDriveModel, columns
from flexstage.hysteresis.coupled_drives.model_file import read_coupled_model
from flexstage.hysteresis.coupled_drives.prediction import require_columns
from flexstage.hysteresis.drive_model import in_unit_of_model
from flexstage.hysteresis.model import checked
from flexstage.hysteresis.requests import CompensateRequest
from flexstage.quantities.units import readable
from flexstage.records.record import Channel, Record

if TYPE_CHECKING:
    import pandas


@dataclass(frozen=True, slots=True)
class _Inverse:
    """Numbers of the inverse of the linear system."""

    lead: float = 50.0
    """Periods of the bandwidth before the first reference: the smoothing and the zeros outside the
    unit circle need their commands before, down to 1e-5 of the largest.
    """
    decay: float = 12.0
    """Time constants of the slowest pole after the last reference: to 1e-5."""
    longest: int = 1 << 18
    """Most samples of this decay, for memory."""
    weakest: float = 1e-3
    """Directions of less than this part of the largest gain at a frequency are not driven: the
    records do not determine them.
    """
    mirrored: float = 2.0
    """A motion before the references that needs this times smaller inputs is taken: less does not
    outweigh that it is longer.
    """
    rest: float = 1e-4
    """Commands below this part of the largest are rest, with which no file begins."""
    lines: int = 1 << 14
    """Lines that are inverted at once, for memory."""


_INVERSE = _Inverse()


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CoupledCommand(Result):
    """Commands of coupled drives for references, and what the model predicts."""

    model: CoupledDriveModel
    """The model."""
    time: Array
    """Times [s], 0 at the first sample of the references, shape (n,)."""
    command: Array
    """Commands, deviations from the operating point [unit of the inputs], shape (n, m)."""
    reference: Array
    """Smoothed references, with their beginning from rest [unit of the outputs], shape (n, p)."""
    requested: Array
    """References before smoothing, of the last samples, shape (n - lead, p)."""
    predicted: Array
    """Readings of the model for the commands, stepped from rest, shape (n, p)."""
    limited: int
    """Number of samples at which a limit changed a command."""
    notes: tuple[str, ...]
    """Changes of references and commands, with the resulting errors."""

    @property
    def lead(self) -> int:
        """Number of samples before the references."""
        return len(self.time) - len(self.requested)

    @property
    def smoothing(self) -> float:
        """Largest change of the references by smoothing [unit of the outputs]."""
        return float(np.max(np.abs(self.reference[self.lead :] - self.requested)))

    @property
    def rms_error(self) -> Array:
        """Rms of the prediction less the requested reference, of each output."""
        return np.sqrt(np.mean((self.predicted[self.lead :] - self.requested) ** 2, axis=0))

    @property
    def largest_error(self) -> Array:
        """Largest absolute value of the prediction less the requested reference, of each output."""
        return np.max(np.abs(self.predicted[self.lead :] - self.requested), axis=0)

    def record(self) -> Record:
        """Return commands, references and predictions over time."""
        model = self.model
        channels = [
            Channel(name=f"{name}{suffix}", values=np.ascontiguousarray(values), unit=unit)
            for names, suffix, array, unit in (
                (model.inputs, "", self.command, model.input_unit),
                (model.outputs, " reference", self.reference, model.output_unit),
                (model.outputs, " predicted", self.predicted, model.output_unit),
            )
            for name, values in zip(names, array.T, strict=True)
        ]
        return Record(channels=tuple(channels), time=self.time, source="flexstage compensate")

    def data(self) -> dict[str, Any]:
        """Return ranges and errors by input and output as plain data."""
        model, by_output = self.model, (self.rms_error, self.largest_error)
        ranges = np.column_stack((self.command.min(0), self.command.max(0))).tolist()
        errors = [dict(zip(model.outputs, e.tolist(), strict=True)) for e in by_output]
        return {
            "samples": len(self.time),
            "samples_before_reference": self.lead,
            "command_range": dict(zip(model.inputs, ranges, strict=True)),
            **picked(model, "input_unit", "output_unit"),
            "predicted_rms_error": errors[0],
            "predicted_max_error": errors[1],
            "smoothing": self.smoothing,
            "limited_samples": self.limited,
            "notes": list(self.notes),
        }

    def to_frame(self) -> "pandas.DataFrame":
        """Return the record as a data frame."""
        return self.record().to_frame()


def compensate_record(
    path: Path, record: Record, names: Sequence[str | int], request: CompensateRequest
) -> CoupledCommand:
    """Return the commands by which the drives of a model file follow columns of a record."""
    model, channels = read_coupled_model(path), [record.channel(name) for name in names]
    require_columns(model, record, "outputs", names)
    converted = [
        in_unit_of_model(c.values, c.unit, model.output_unit, "reference") for c in channels
    ]
    result = coupled_commands(
        model,
        np.column_stack([values for values, _ in converted]),
        limits=request.voltage,
        largest_rate=request.amplifier.largest_rate,
        band_hz=request.reference_bandwidth,
    )
    notes = (*dict.fromkeys(n for _, n in converted if n), *result.notes, *record.notes)
    return replace(result, request=request, notes=notes)


def coupled_commands(
    model: CoupledDriveModel,
    references: ArrayLike,
    *,
    limits: tuple[float, float] | None = None,
    largest_rate: float | None = None,
    band_hz: float | None = None,
) -> CoupledCommand:
    r"""Return the commands that make the outputs of coupled drives follow references.

    The linear system is inverted at each frequency, which needs commands before the first
    reference; the drives that soften are inverted exactly, sample by sample
    (`CoupledDriveModel.voltages`).

    Parameters
    ----------
    model : CoupledDriveModel
        The drives.
    references : array_like
        References of all outputs, deviations from the operating point, shape (n, p). Before, the
        stage rests there; a smooth step leads to the first reference.
    limits : tuple of float, optional
        Lowest and highest command, deviations from the operating point; that of the input that
        moved least in the records where not given.
    largest_rate : float, optional
        Largest rate of a command [unit of the inputs per second].
    band_hz : float, optional
        Bandwidth of the smoothed references [Hz]: content below is not changed, content above twice
        of it and above the records is omitted. Half the highest frequency of the records where not
        given.

    Returns
    -------
    CoupledCommand
        The commands.

    Raises
    ------
    ModelError
        References have another shape or are not finite, the bandwidth is above the records, or the
        commands need a level that no record had.

    Notes
    -----
    S. Devasia, D. Chen and B. Paden, IEEE Trans. Automat. Contr. 41 (1996) 930: stable inversion.
    With more outputs than inputs, references are followed in the sense of least squares; with
    fewer, by the smallest voltages.

    Validity: as `CoupledDriveModel`. Below the lowest frequency of the records gains are
    extrapolated. A limit changes a command without regard to the resonances that this excites.
    """
    requested = columns(references, len(model.outputs), "references")
    if len(requested) < 2:
        raise ModelError("references need at least two samples, got one")
    rate, highest = model.sample_rate_hz, model.band_hz[1]
    band = (
        0.5 * highest if band_hz is None else checked(band_hz, "band", "positive and finite", "Hz")
    )
    if band > highest:
        raise ModelError(
            f"a bandwidth of {band:g} Hz is above the records of the model, which end at "
            f"{highest:g} Hz: reduce it"
        )
    lead = int(np.ceil(_INVERSE.lead * rate / band))
    smooth, totals = _inverted(model, requested, lead, band)
    largest = min(model.largest_input)
    low, high = (-largest, largest) if limits is None else limits
    if not low <= 0.0 <= high:
        raise ModelError(
            f"limits of the commands count from the operating point and must contain 0, got "
            f"{low:g} to {high:g}"
        )
    slew = largest_rate or np.inf
    command, _ = model.voltages(totals, limits=(low, high), largest_rate=slew)
    moves = np.max(np.abs(command), axis=1) > _INVERSE.rest * np.max(np.abs(command))
    first = min(int(np.argmax(moves)), lead)
    command, smooth = command[first:], smooth[first:]
    predicted, _ = model.simulate(command)
    steps = np.abs(np.diff(command, axis=0, prepend=command[:1])) * rate
    limited = (command <= low) | (command >= high) | (steps > (1.0 - 1e-9) * slew)
    result = CoupledCommand(
        model=model,
        time=(np.arange(len(command)) - (lead - first)) / rate,
        command=command,
        reference=smooth,
        requested=requested,
        predicted=predicted,
        limited=int(np.sum(np.any(limited, axis=1))),
        notes=(),
    )
    return replace(result, notes=_notes(result, band))


def _inverted(
    model: CoupledDriveModel, references: Array, lead: int, band: float
) -> tuple[Array, Array]:
    """Return smoothed references from rest, and the inputs of the linear system for them.

    The motion before is a step to the first reference, or the mirrored references where a step
    needs much larger inputs: a resonance reaches positions at which no drive holds the stage.
    """
    step = 0.5 - 0.5 * np.cos(np.pi * np.arange(lead) / lead)[:, None]
    results = []
    for kind in ("odd", "even"):
        # what follows is not commanded, but the last commands prepare for it
        path = np.pad(references, ((lead, lead), (0, 0)), mode="reflect", reflect_type=kind)
        path[:lead] = step * (references[0] if kind == "odd" else path[:lead])
        path[-lead:] *= step[::-1]
        pair = _inverse_of_path(model, path, band)
        results.append([np.ascontiguousarray(x[:-lead]) for x in pair])
    stepped, mirrored = (np.max(np.abs(inputs)) for _, inputs in results)
    smooth, inputs = results[int(stepped > _INVERSE.mirrored * mirrored)]
    return smooth, inputs


def _inverse_of_path(model: CoupledDriveModel, path: Array, band: float) -> tuple[Array, Array]:
    """Return a smoothed path, and the inputs of the linear system for it."""
    rate, system = model.sample_rate_hz, model.system
    slowest = -1.0 / np.log(np.clip(np.max(np.abs(system.poles)), 0.5, 1.0 - 1e-9))
    size = 1 << (len(path) + int(min(_INVERSE.decay * slowest, _INVERSE.longest))).bit_length()
    frequency = np.fft.rfftfreq(size, 1.0 / rate)
    end = min(2.0 * band, model.band_hz[1])
    fall = np.clip((frequency - band) / max(end - band, frequency[1]), 0.0, 1.0)
    spectrum = np.fft.rfft(path, size, axis=0) * (0.5 + 0.5 * np.cos(np.pi * fall))[:, None]
    inputs = np.zeros((len(frequency), len(model.inputs)), complex)
    for at in range(0, int(np.searchsorted(frequency, end)) + 1, _INVERSE.lines):
        part = slice(at, at + _INVERSE.lines)
        response = system.response(np.exp(2j * np.pi * frequency[part] / rate))
        inverse = np.linalg.pinv(response, rcond=_INVERSE.weakest)
        inputs[part] = np.einsum("lmp,lp->lm", inverse, spectrum[part])
    smooth, totals = (np.fft.irfft(x, size, axis=0)[: len(path)] for x in (spectrum, inputs))
    return smooth, totals


def _notes(result: CoupledCommand, band: float) -> tuple[str, ...]:
    """Return how references and commands were changed, and what the records do not cover."""
    model, notes = result.model, []
    if result.smoothing > _INVERSE.rest * np.max(np.abs(result.requested)):
        notes.append(
            f"the references were smoothed to a bandwidth of {band:.3g} Hz: they changed by at "
            f"most {readable(model.output_unit, result.smoothing)}"
        )
    lowest = model.band_hz[0]
    content = np.abs(np.fft.rfft(result.requested, axis=0))
    below = np.fft.rfftfreq(len(result.requested), 1.0 / model.sample_rate_hz) < lowest
    if np.max(content[below], initial=0.0) > _INVERSE.rest * np.max(content):
        notes.append(
            f"the references have content below {lowest:.3g} Hz, the lowest frequency of the "
            "records: the gain there is extrapolated"
        )
    if result.lead:
        notes.append(
            f"the commands begin {readable('s', -float(result.time[0]))} before the references, at "
            "rest at the operating point"
        )
    if result.limited:
        lost = float(np.max(np.abs(result.predicted - result.reference)))
        notes.append(
            f"limits changed {result.limited} of {len(result.time)} samples of the commands; the "
            f"largest resulting error is {readable(model.output_unit, lost)}"
        )
    rms = np.sqrt(np.mean(result.command**2, axis=0))
    weak = [
        n for n, (low, _), r in zip(model.inputs, model.level_range, rms, strict=True) if r < low
    ]
    if weak:
        notes.append(
            f"the levels of {', '.join(weak)} are below those of the records: how little the stage "
            "softens there is extrapolated"
        )
    return tuple(notes)
