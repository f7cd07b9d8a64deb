"""What a step gave that centred a scale."""

from dataclasses import dataclass

__all__ = [
    "CentredMove",
    "CentredStep",
]


@dataclass(frozen=True, slots=True, kw_only=True)
class CentredMove:
    """One measurement of the eccentricity, and what was done before it.

    Parameters
    ----------
    kind : str
        ``start``, ``trial`` or ``move``.
    command : tuple of float
        Commands of the axes, from the middle of their ranges [m].
    eccentricity : tuple of float
        Centre of the scale that was measured then, x and y on the table [m].
    length, uncertainty : float
        Its distance from the centre, and the expanded uncertainty of that at 95 % [m].
    predicted : float or None
        What the move was expected to leave [m]; None before the moves were known.
    true_length : float
        Where the centre of the simulated scale really was [m].
    """

    kind: str
    command: tuple[float, float]
    eccentricity: tuple[float, float]
    length: float
    uncertainty: float
    predicted: float | None
    true_length: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CentredStep:
    """A scale that was centred.

    Parameters
    ----------
    name : str
        Name of the step.
    axes : tuple of str
        The axes that moved it.
    target : float
        Eccentricity that was asked for [m].
    reached : bool
        Whether the upper end of the 95 % interval of what was measured last is below it.
    reason : str
        Why it ended.
    moves : tuple of CentredMove
        Every measurement and move.
    notes : tuple of str
        What a reader should know.
    """

    name: str
    axes: tuple[str, str]
    target: float
    reached: bool
    reason: str
    moves: tuple[CentredMove, ...]
    notes: tuple[str, ...] = ()
