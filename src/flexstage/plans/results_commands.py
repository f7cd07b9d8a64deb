"""What a step gave that designed a command or measured: commands, records, figures."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from flexstage.arrays import Array
from flexstage.experiment.campaign.results import Characterisation, Figure
from flexstage.records import Record


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CommandedStep:
    """A command that was designed."""

    name: str
    """Name of the step."""
    axis: str
    """The axis, or both such as ``xy``."""
    kind: str
    """Kind of the command."""
    time: Array
    """Times of its samples [s], shape (n,); empty of blows."""
    values: Mapping[str, Array]
    """Its samples by axis [V or m], each of shape (n,)."""
    unit: str
    """Unit of the samples."""
    notes: tuple[str, ...] = ()
    """What a reader should know."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MeasuredStep:
    """A record that was taken."""

    name: str
    """Name of the step."""
    axis: str
    """The axis, or both such as ``xy``."""
    test: str
    """Kind of test that it is; empty where it only serves to identify."""
    record: Record
    """All samples."""
    first: int
    """Number of samples at its beginning that prepare, and are not evaluated."""
    period: int
    """Samples of a cycle; 0 where there are none."""
    file: Path
    """The file that holds it."""
    repeated: bool
    """Whether it was taken now; False where an earlier run of the same plan had taken it."""
    notes: tuple[str, ...] = ()
    """What a reader should know."""

    @property
    def evaluated(self) -> Record:
        """The record without what prepares."""
        from dataclasses import replace

        if self.first == 0 or self.record.over != "time":
            return self.record
        kept = slice(self.first, None)
        return replace(
            self.record,
            channels=tuple(replace(c, values=c.values[kept]) for c in self.record.channels),
            time=self.record.time[kept] - self.record.time[self.first],
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CharacterisedStep:
    """Figures of tests."""

    name: str
    """Name of the step."""
    found: Characterisation
    """What the tests gave, with the curves behind each figure."""
    ratios: tuple[Figure, ...] = ()
    """Motion of the platform over that of the drive, of the motions that were commanded in metres.
    """

    @property
    def figures(self) -> tuple[Figure, ...]:
        """All figures, test by test."""
        own = tuple(figure for result in self.found.results for figure in result.figures)
        return (*own, *self.ratios)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CompensatedStep:
    """A command that was made from the inverse of a model."""

    name: str
    """Name of the step."""
    axis: str
    """The axis."""
    time: Array
    """Times [s], shape (n,)."""
    reference: Array
    """What shall be followed [m], shape (n,)."""
    voltage: Array
    """The command [V], shape (n,)."""
    predicted: Array
    """What the model says will come [m], shape (n,)."""
    notes: tuple[str, ...] = ()
    """What was changed."""
