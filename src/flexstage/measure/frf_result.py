"""What records of vibration give: responses with their modes, and the modes of a free decay."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from flexstage.files.plain import picked
from flexstage.files.result import Result
from flexstage.measure.modal.result import ModalFit, Mode
from flexstage.measure.modal.ring_down import DecayMode, RingDown
from flexstage.measure.spectra.estimate import ResponseEstimate
from flexstage.measure.spectra.response import MeasuredResponse
from flexstage.quantities.estimate import Estimate
from flexstage.records import Channel, Record

#: Share of a response beyond which what a fit leaves says that its modes are none of it.
_NO_FIT = 0.5


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FrfResult(Result):
    """Responses that records give, or hold, and the modes in them."""

    table_key: ClassVar[str] = "modes"

    records: Sequence[Record]
    """The records."""
    response: MeasuredResponse
    """The response; the first of several."""
    estimate: ResponseEstimate | None
    """How it was estimated; None of a response that was measured."""
    fit: ModalFit | None
    """The modes; None where none were asked for."""

    @property
    def modes(self) -> tuple[Mode, ...]:
        """The modes, rising in frequency."""
        return () if self.fit is None else self.fit.modes

    def data(self) -> dict[str, Any]:
        response, estimate, fit = self.response, self.estimate, self.fit
        notes = [*response.notes, *(() if estimate is None else estimate.notes)]
        said: dict[str, Any] = {
            "records": [r.source for r in self.records],
            **picked(response, "inputs", "outputs", "estimator"),
            "excitation": "" if estimate is None else estimate.excitation,
            "averages": response.averages,
            "lines": int(response.frequency_hz.size),
            "frequency_range_hz": [
                float(response.frequency_hz[0]),
                float(response.frequency_hz[-1]),
            ],
            "modes": [],
        }
        if fit is not None:
            said["band_hz"] = list(fit.band)
            said["modes"] = [_mode(mode, fit.outputs) for mode in fit.modes]
            said["reduced_chi_squared"] = fit.reduced_chi_squared
            for name in ("delay", "lag"):
                estimated = getattr(fit, name)
                if estimated is not None:
                    said[name] = _estimate(estimated)
            unlike = max(float(one.residual_rms.max()) for one in fit.fitted)
            first = 1 if fit.modes and unlike > _NO_FIT else 0
            said["warnings"] = list(fit.notes[:first])
            notes += fit.notes[first:]
        return said | {"notes": _notes(self.records, notes)}

    def record(self) -> Record:
        """Return the response as columns, for other programs.

        Frequency; real and imaginary part, variance and coherence as far as they are known, and by
        how much a window has mixed neighbouring lines.
        """
        response = self.response
        channels = [Channel(name="frequency", values=response.frequency_hz, unit="Hz")]
        for o, name in enumerate(response.outputs):
            for i, other in enumerate(response.inputs):
                h = response.response[:, o, i]
                label = f"{name}/{other}"
                unit = _quotient(response, o, i)
                channels += [
                    Channel(name=f"{label} real", values=h.real.copy(), unit=unit),
                    Channel(name=f"{label} imaginary", values=h.imag.copy(), unit=unit),
                ]
                if response.variance is not None:
                    channels.append(
                        Channel(name=f"{label} variance", values=response.variance[:, o, i].copy())
                    )
            if response.coherence is not None:
                channels.append(
                    Channel(name=f"{name} coherence", values=response.coherence[:, o].copy())
                )
        if response.blur:
            blur = np.full(response.frequency_hz.size, response.blur)
            channels.append(Channel(name="blur", values=blur))
        return Record(
            channels=tuple(channels),
            time=np.arange(response.frequency_hz.size, dtype=np.float64),
            source=", ".join(r.source for r in self.records),
            notes=response.notes,
            over="point",
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DecayResult(Result):
    """A free decay, and the modes in it."""

    table_key: ClassVar[str] = "modes"

    record: Record
    """The record."""
    fit: RingDown
    """The modes."""

    @property
    def modes(self) -> tuple[DecayMode, ...]:
        """The modes, rising in frequency."""
        return self.fit.modes

    def data(self) -> dict[str, Any]:
        return {
            "records": [self.record.source],
            "modes": [_mode(mode, self.fit.channels) for mode in self.modes],
            "notes": _notes([self.record], self.fit.notes),
        }


def _notes(records: Sequence[Record], found: Iterable[str]) -> list[str]:
    """Return which columns were taken, then what was found, then what the files said."""
    said = [note for record in records for note in record.notes]
    first = [note for note in said[:1] if note.endswith("taken by units and names")]
    return list(dict.fromkeys((*first, *found, *said)))


def _quotient(response: MeasuredResponse, o: int, i: int) -> str:
    """Return the unit of a response; empty where that of output or input is not known."""
    if not response.output_units or not response.input_units:
        return ""
    above, below = response.output_units[o], response.input_units[i]
    if not above or not below:
        return ""
    return f"{above}/({below})" if "/" in below else f"{above}/{below}"


def _mode(mode: Mode | DecayMode, outputs: Sequence[str]) -> dict[str, Any]:
    """Return a mode as plain data."""
    return {
        "frequency_hz": _estimate(mode.frequency_hz),
        "damping_ratio": _estimate(mode.damping_ratio),
        "shape": [
            {
                "output": name,
                "real": float(value.real) if np.isfinite(value) else None,
                "imaginary": float(value.imag) if np.isfinite(value) else None,
            }
            for name, value in zip(outputs, mode.shape, strict=True)
        ],
    }


def _estimate(estimate: Estimate) -> dict[str, Any]:
    return picked(estimate, "value", "uncertainty", "degrees_of_freedom", "interval", "unit")
