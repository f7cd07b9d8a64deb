"""Commands of the digital outputs: at which points of a waveform they switch, and what they show.

The simulated controller has lines that nothing is connected to: their settings are kept and told.
"""

from collections.abc import Sequence

from flexstage.instruments.twin import errors_gcs as code
from flexstage.instruments.twin.command import Client, GcsCommand, Reply
from flexstage.instruments.twin.commands_identity import nothing
from flexstage.instruments.twin.errors_gcs import GcsError
from flexstage.instruments.twin.gcs_arguments import number, switch, unsigned
from flexstage.instruments.twin.gcs_state import ControllerState

_LINES = 3
#: Settings of a line: width, axis, kind, lowest and highest position, polarity, offset.
_SETTINGS = range(1, 12)


def _line(word: str) -> int:
    line = unsigned(word)
    if not 1 <= line <= _LINES:
        raise GcsError(code.OUT_OF_RANGE)
    return line


def _triples(words: Sequence[str]) -> list[Sequence[str]]:
    if not words or len(words) % 3:
        raise GcsError(code.NUMBER_OF_PARAMETERS)
    return [words[i : i + 3] for i in range(0, len(words), 3)]


def _set_points(state: ControllerState, _: Client, words: Sequence[str]) -> Reply:
    given = {}
    for line, point, on in _triples(words):
        at = unsigned(point)
        if not 1 <= at <= state.device.wave_capacity:
            raise GcsError(code.OUT_OF_RANGE)
        given[_line(line), at] = switch(on)
    state.trigger_points.update(given)
    return None


def _clear_points(state: ControllerState, _: Client, words: Sequence[str]) -> Reply:
    nothing(words)
    state.trigger_points.clear()
    return None


def _points(state: ControllerState, _: Client, words: Sequence[str]) -> Reply:
    lines = [_line(word) for word in words] or range(1, _LINES + 1)
    found = [(n, p) for n, p in sorted(state.trigger_points) if n in lines]
    return [f"{n} {p}={int(state.trigger_points[n, p])}" for n, p in found] or ["0"]


def _set_line(state: ControllerState, _: Client, words: Sequence[str]) -> Reply:
    given = {}
    for line, setting, word in _triples(words):
        key = unsigned(setting)
        if key not in _SETTINGS:
            raise GcsError(code.OUT_OF_RANGE)
        number(word)
        given[_line(line), key] = word
    state.trigger_settings.update(given)
    return None


def _settings(state: ControllerState, _: Client, words: Sequence[str]) -> Reply:
    if len(words) % 2:
        raise GcsError(code.NUMBER_OF_PARAMETERS)
    asked = [(_line(a), unsigned(b)) for a, b in zip(words[::2], words[1::2], strict=True)]
    for key in asked:
        if key[1] not in _SETTINGS:
            raise GcsError(code.OUT_OF_RANGE)
    known = asked or sorted(state.trigger_settings)
    return [f"{n} {key}={state.trigger_settings.get((n, key), '0')}" for n, key in known] or ["0"]


#: Commands of the digital outputs.
TRIGGERS = (
    GcsCommand(
        name="CTO",
        arguments="{<TrigOutID> <CTOPam> <Value>}",
        text="Set Configuration Of Trigger Output",
        run=_set_line,
        changes=True,
    ),
    GcsCommand(
        name="CTO?",
        arguments="[{<TrigOutID> <CTOPam>}]",
        text="Get Configuration Of Trigger Output",
        run=_settings,
    ),
    GcsCommand(
        name="TWC",
        arguments="",
        text="Clear All Wave Related Triggers",
        run=_clear_points,
        changes=True,
    ),
    GcsCommand(
        name="TWS",
        arguments="{<TrigOutID> <PointNumber> <Switch>}",
        text="Set Trigger Line Actions To Waveform Points",
        run=_set_points,
        changes=True,
    ),
    GcsCommand(
        name="TWS?",
        arguments="[{<TrigOutID>}]",
        text="Get Trigger Line Actions At Waveform Points",
        run=_points,
    ),
)
