"""An identified oscillator with columns and range of its record: its file, and what it predicts."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from flexstage.base.errors import ModelError
from flexstage.files.decoder import read_file
from flexstage.files.format import Format
from flexstage.hysteresis.coupled_drives.model_file import begins_as, description_text
from flexstage.hysteresis.coupled_drives.prediction import CoupledPrediction, CoupledPredictions
from flexstage.hysteresis.drive_model import in_unit_of_model
from flexstage.hysteresis.model_file import MODEL_FILE
from flexstage.hysteresis.oscillator.model import BoucWenOscillator
from flexstage.quantities.units import readable
from flexstage.records.record import Record

#: The kind of file that holds an identified oscillator.
OSCILLATOR_FILE = Format(
    noun="oscillator from `flexstage identify --out`",
    key="flexstage-oscillator",
    error=ModelError,
    only=True,
    forms=MODEL_FILE.forms,
)
#: Part of a record that shows its start: at rest, or in a motion that repeats.
_FIRST = 0.1
#: A motion of the size of the record is no extrapolation; peaks of one level scatter.
_LARGER = 1.1
#: Periods of small motion in which the first input is reached, and as many in which it is held.
_LEAD = 100.0


@dataclass(frozen=True, slots=True, kw_only=True)
class OscillatorModel:
    """An identified oscillator, and the columns, units and range of its record.

    Validity: as `BoucWenOscillator`, for displacements up to the largest one.
    """

    oscillator: BoucWenOscillator
    """The oscillator, in the units of the columns."""
    offset: float
    """Reading at zero displacement."""
    inputs: tuple[str, ...]
    """Name of the input."""
    outputs: tuple[str, ...]
    """Name of the output."""
    input_unit: str
    """Unit of the input."""
    output_unit: str
    """Unit of the output."""
    largest: float
    """Largest displacement of the record."""
    error: float
    """Rms error on the record."""
    warnings: tuple[str, ...] = ()
    """What the record does not determine."""

    @property
    def frequency_hz(self) -> float:
        """Natural frequency of small motion [Hz]; NaN if it has none."""
        ratio = (self.oscillator.stiffness + self.oscillator.alpha) / self.oscillator.mass
        return math.sqrt(ratio) / (2.0 * math.pi) if ratio > 0.0 else math.nan

    def predict(
        self, record: Record, input_column: str | int, output_column: str | int
    ) -> CoupledPrediction:
        """Return the prediction of a record whose start is unknown.

        It begins at rest without or under its first input, or is one period of a motion that
        repeats: whichever is nearest to the first tenth of the output.
        """
        u, y = (
            in_unit_of_model(channel.values, channel.unit, unit, side)[0]
            for channel, unit, side in (
                (record.channel(input_column), self.input_unit, "input"),
                (record.channel(output_column), self.output_unit, "output"),
            )
        )
        first = slice(0, max(round(_FIRST * u.size), 2))
        rate, n = record.sample_rate_hz, u.size
        # from zero to the first input within some periods, and some more until it rests
        lead = round(min(_LEAD * rate / self.frequency_hz, n)) if self.frequency_hz > 0.0 else 2
        rise = 0.5 - 0.5 * np.cos(np.pi * np.arange(lead) / lead)
        before = u[0] * np.concatenate((rise, np.ones(lead)))
        led = self.oscillator.simulate(np.concatenate((before, u)), rate).displacement
        starts = {
            "at rest": self.oscillator.simulate(u, rate).displacement,
            "at rest under its first input": led[before.size :],
        }
        try:
            twice = self.oscillator.simulate(np.tile(u, 2), rate, interpolation="periodic")
            starts["in a motion that repeats"] = twice.displacement[n:]
        except ModelError:  # it diverges: the record does not repeat
            pass
        errors = {name: float(np.std((motion - y)[first])) for name, motion in starts.items()}
        start = min(errors, key=lambda name: errors[name])
        predicted = starts[start]
        source = Path(record.source).name or "record"
        notes = [f"{source} is taken to begin {start}"]
        reached = float(np.max(np.abs(predicted)))
        if reached > _LARGER * self.largest:
            there, before = (readable(self.output_unit, v) for v in (reached, self.largest))
            notes.append(
                f"{source} moves by {there}, and the record of the model by {before}: beyond it "
                "the model is an extrapolation"
            )
        return CoupledPrediction(
            source=source,
            time=record.time,
            measured=y[:, None] - self.offset,
            predicted=predicted[:, None],
            warm_up=0,
            notes=(*notes, *record.notes),
        )

    def predictions(
        self, records: Sequence[Record], input_column: str | int, output_column: str | int
    ) -> CoupledPredictions:
        """Return the predictions of several records."""
        predictions = tuple(self.predict(r, input_column, output_column) for r in records)
        return CoupledPredictions(model=self, predictions=predictions)


def oscillator_text(model: OscillatorModel) -> str:
    """Return an identified oscillator as YAML, which `read_oscillator` reads."""
    return description_text(OSCILLATOR_FILE, model)


def is_oscillator(path: Path) -> bool:
    """Return whether a file begins as an identified oscillator; a missing one does not."""
    return begins_as(path, OSCILLATOR_FILE)


def read_oscillator(path: Path) -> OscillatorModel:
    """Read an identified oscillator; a ModelError where the file is none."""
    decoder, root = read_file(path, OSCILLATOR_FILE)
    model: OscillatorModel = decoder.build(OscillatorModel, root, "")
    return model
