"""What is asked for in the view Hysteresis: of files, of models, and of a motion."""

from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, Literal

#: What is not said about how files are read, as `flexstage.records.reading_options` names it.
_HOW = ("sample_rate", "time", "resample", "rows", "format", "dataset", "delimiter", "decimal")


@dataclass(frozen=True, slots=True, kw_only=True)
class Reading:
    """Files, and how they are read: texts as the options of `flexstage identify`."""

    files: tuple[str, ...] = ()
    """The files."""
    input: str = ""
    """Column that drives."""
    output: str = ""
    """Column that follows."""
    branches: str = ""
    """Columns of the rising and the falling branch, in a table without times."""
    curve: str = ""
    """How first-order reversal curves lie in a table without times."""
    input_unit: str = ""
    """Unit of the input, where the file does not say it."""
    output_unit: str = ""
    """Unit of the output."""
    sample_rate: str = ""
    """Sample rate, where the file does not say it."""
    time: str = ""
    """Column of the times."""
    resample: str = ""
    """Rate of even times."""
    rows: str = ""
    """Samples that are read."""
    format: str = ""
    """Format of the file."""
    dataset: str = ""
    """Which of the datasets of a file."""
    skip_lines: str = ""
    """Lines at the start of a text that are left out."""
    delimiter: str = ""
    """What divides the columns of a text."""
    decimal: str = ""
    """The decimal sign of a text."""

    @property
    def how(self) -> dict[str, Any]:
        """What goes to `understood`, but for the number of lines."""
        return {name: getattr(self, name).strip() or None for name in _HOW}

    @property
    def names(self) -> list[str]:
        """Names of the files."""
        return [Path(file).name for file in self.files]

    @property
    def is_table(self) -> bool:
        """Whether it is of branches or curves, in tables without times."""
        return bool(self.branches or self.curve)

    @property
    def unusual(self) -> bool:
        """Whether anything is said that most files do not need."""
        rest = {f.name for f in fields(self)} - {
            "files", "input", "output", "input_unit", "output_unit", "sample_rate", "time",
        }  # fmt: skip
        return any(getattr(self, name) for name in rest)


@dataclass(frozen=True, slots=True, kw_only=True)
class Search:
    """What is identified, and what is known before."""

    models: tuple[str, ...] = ()
    """Kinds of hysteresis models; none for those that are tried unless named."""
    train: str = ""
    """Samples to fit; empty for all."""
    drift: bool = False
    """Whether a drift of constant speed is fitted beside the model."""
    delay: float | None = None
    """Known delay of the output [s]."""
    creep: float | None = None
    """Known creep per decade of time [1]."""
    resonance_hz: float | None = None
    """Known resonance [Hz]."""
    damping_ratio: float | None = None
    """Damping ratio of that [1]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class WantedMotion:
    """What a drive shall follow, and within which limits; lengths in the unit of the model."""

    shape: Literal["sine", "triangle", "file"] = "sine"
    """What it is."""
    centre: float | None = None
    """Middle of a sine or triangle; that of the range of the model where None."""
    amplitude: float | None = None
    """Half of its range; two fifths of the range of the model where None."""
    rate_hz: float | None = None
    """Its rate [Hz]; the slowest that the model was identified at where None."""
    sample_rate_hz: float | None = None
    """Samples in a second [Hz]; those of the record where None."""
    periods: int = 4
    """How often it is repeated; 0 for one period that repeats without end."""
    file: Reading = Reading()
    """The file, for a reference out of one: its column is the output."""
    relative: bool = False
    """Whether a reference out of a file counts from the lowest reading of the drive."""
    lowest: float | None = None
    """Lowest command; that of the record where None."""
    highest: float | None = None
    """Highest command."""
    slew: float | None = None
    """Largest rate of the command [unit of the input per second]."""
    band_hz: float | None = None
    """Bandwidth to which the reference is smoothed [Hz]."""
    start: Literal["conditioned", "rest", "moved"] = "conditioned"
    """State of the drive before."""
    moved_for: float = 30.0
    """For how long it had moved [s], where it had."""
