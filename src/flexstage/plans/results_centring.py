"""What a step gave that centred a scale."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class CentredMove:
    """One measurement of the eccentricity, and what was done before it."""

    kind: str
    """``start``, ``trial`` or ``move``."""
    command: tuple[float, float]
    """Commands of the axes, from the middle of their ranges [m]."""
    eccentricity: tuple[float, float]
    """Centre of the scale that was measured then, x and y on the table [m]."""
    length: float
    """Its distance from the centre, and the expanded uncertainty of that at 95 % [m]."""
    uncertainty: float
    """Its distance from the centre, and the expanded uncertainty of that at 95 % [m]."""
    predicted: float | None
    """What the move was expected to leave [m]; None before the moves were known."""
    true_length: float
    """Where the centre of the simulated scale really was [m]."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CentredStep:
    """A scale that was centred."""

    name: str
    """Name of the step."""
    axes: tuple[str, str]
    """The axes that moved it."""
    target: float
    """Eccentricity that was asked for [m]."""
    reached: bool
    """Whether the upper end of the 95 % interval of what was measured last is below it."""
    reason: str
    """Why it ended."""
    moves: tuple[CentredMove, ...]
    """Every measurement and move."""
    notes: tuple[str, ...] = ()
    """What a reader should know."""
