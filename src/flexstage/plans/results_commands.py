"""What a step gave that designed a command or measured: commands, records, figures."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from flexstage.experiment.campaign import Characterisation, Figure
from flexstage.records import Record

__all__ = [
    "CharacterisedStep",
    "CommandedStep",
    "CompensatedStep",
    "MeasuredStep",
]

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CommandedStep:
    """A command that was designed.

    Parameters
    ----------
    name : str
        Name of the step.
    axis : str
        The axis, or both such as ``xy``.
    kind : str
        Kind of the command.
    time : numpy.ndarray
        Times of its samples [s], shape (n,); empty of blows.
    values : Mapping
        Its samples by axis [V or m], each of shape (n,).
    unit : str
        Unit of the samples.
    notes : tuple of str
        What a reader should know.
    """

    name: str
    axis: str
    kind: str
    time: Array
    values: Mapping[str, Array]
    unit: str
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MeasuredStep:
    """A record that was taken.

    Parameters
    ----------
    name : str
        Name of the step.
    axis : str
        The axis, or both such as ``xy``.
    test : str
        Kind of test that it is; empty where it only serves to identify.
    record : Record
        All samples.
    first : int
        Number of samples at its beginning that prepare, and are not evaluated.
    period : int
        Samples of a cycle; 0 where there are none.
    file : pathlib.Path
        The file that holds it.
    repeated : bool
        Whether it was taken now; False where an earlier run of the same plan had taken it.
    notes : tuple of str
        What a reader should know.
    """

    name: str
    axis: str
    test: str
    record: Record
    first: int
    period: int
    file: Path
    repeated: bool
    notes: tuple[str, ...] = ()

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
    """Figures of tests.

    Parameters
    ----------
    name : str
        Name of the step.
    found : Characterisation
        What the tests gave, with the curves behind each figure.
    ratios : tuple of Figure
        Motion of the platform over that of the drive, of the motions that were commanded in metres.
    """

    name: str
    found: Characterisation
    ratios: tuple[Figure, ...] = ()

    @property
    def figures(self) -> tuple[Figure, ...]:
        """All figures, test by test."""
        own = tuple(figure for result in self.found.results for figure in result.figures)
        return (*own, *self.ratios)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CompensatedStep:
    """A command that was made from the inverse of a model.

    Parameters
    ----------
    name : str
        Name of the step.
    axis : str
        The axis.
    time : numpy.ndarray
        Times [s], shape (n,).
    reference : numpy.ndarray
        What shall be followed [m], shape (n,).
    voltage : numpy.ndarray
        The command [V], shape (n,).
    predicted : numpy.ndarray
        What the model says will come [m], shape (n,).
    notes : tuple of str
        What was changed.
    """

    name: str
    axis: str
    time: Array
    reference: Array
    voltage: Array
    predicted: Array
    notes: tuple[str, ...] = ()
