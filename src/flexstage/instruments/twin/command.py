"""What a command of the command set is."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol

from flexstage.instruments.twin.gcs_state import ControllerState

#: Lines of an answer; pieces of text that are made after the command, as they are sent; or nothing.
Reply = Sequence[str] | Iterator[str] | None


class Client(Protocol):
    """What a command needs of the session that gives it."""

    #: Number that ``ERR?`` answers next.
    error: int
    #: Command level, 0 or 1.
    level: int


#: Carries a command out, given state, session and words.
Run = Callable[[ControllerState, Client, Sequence[str]], Reply]


@dataclass(frozen=True, slots=True, kw_only=True)
class GcsCommand:
    """A command."""

    name: str
    """Its word."""
    arguments: str
    """Its arguments, as it is listed."""
    text: str
    """What it does, as it is listed."""
    run: Run
    """Carries it out, given state, session and words."""
    changes: bool = False
    """Whether it moves or changes something, and a client that holds control keeps it from others.
    """
    moves: bool = False
    """Whether it can start a motion; one that was given before a stop is not carried out after."""
    poll: bool = False
    """Whether a client repeats it while it waits for a motion, a waveform or a record."""
