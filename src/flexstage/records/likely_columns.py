"""Which columns of a file are what a job asks for, by their units and names."""

import re
from collections.abc import Collection, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from flexstage.base.errors import RecordError
from flexstage.records.contents import column_label, contents, read_whole
from flexstage.records.read_options import ReadOptions
from flexstage.records.record import column_and_unit
from flexstage.records.sampling import TIME_NAMES

_INPUTS = ("input", "in", "u", "voltage", "volt", "spannung", "command", "drive", "force", "kraft")
_OUTPUTS = ("output", "out", "y", "position", "pos", "displacement", "weg", "response", "sensor")
_ERRORS = ("error", "err", "fehler", "deviation", "abweichung", "gauge", "indicator")
_ANGLES = ("angle", "theta", "azimuth", "winkel", "reference")
_MOTIONS = ("m", "rad")
_VIBRATIONS = (*_MOTIONS, "m/s", "rad/s", "m/s^2", "rad/s^2")

Columns = list[dict[str, Any]]


def is_time(column: dict[str, Any]) -> bool:
    """Say whether a column is of times, by its unit or its name."""
    return column["unit"] == "s" or str(column["name"]).casefold() in TIME_NAMES


def moving_columns(found: dict[str, Any]) -> Columns:
    """Return the columns of what `contents` returns that do not stand still, but for the times."""
    columns = (c for c in found["columns"] if not is_time(c))
    return [c for c in columns if (c["smallest"] or 0.0) < (c["largest"] or 0.0)]


def likely_drive(
    moving: Columns, *, vibration: bool = False, driven: Columns | None = None
) -> tuple[Columns, Columns]:
    """Return the columns that may be the input of a drive, and those that may be the output.

    Units tell; where several columns have one, or none has, their names do. Of a `vibration` the
    input may be a force, and an output a velocity or an acceleration.
    """
    if driven is None:
        forced = vibration and any(c["unit"] == "N" for c in moving)
        driven = _told(moving, ("N",) if forced else ("V",), _INPUTS)
    rest = [c for c in moving if c not in driven]
    follows = _told(rest, _VIBRATIONS if vibration else _MOTIONS, _OUTPUTS)
    return driven, follows or [c for c in rest if len(rest) == 1 and not c["unit"]]


def _told(columns: Columns, units: Collection[str], words: Sequence[str]) -> Columns:
    fit = [c for c in columns if c["unit"] in units]
    if len(fit) == 1:
        return fit
    named = (set(re.findall(r"[^\W\d_]+", str(c["name"]).casefold())) for c in fit or columns)
    return [c for c, own in zip(fit or columns, named, strict=True) if own & set(words)] or fit


def taken_drive(
    file: Path,
    columns: tuple[tuple[str | int, ...], tuple[str | int, ...]],
    how: ReadOptions,
    *,
    vibration: bool = False,
    options: tuple[str, str] = ("input", "output"),
) -> tuple[tuple[str | int, ...], tuple[str | int, ...], str]:
    """Return input and outputs of a file, where they are not given, and a line that says so.

    `options` ask for them. Columns that are found are their numbers, and none of responses that
    exist. Raises a `RecordError` where units and names leave a choice.
    """
    found = contents(*read_whole(file, how))
    if vibration and found["over"] != "time" and not any(columns):
        return (), (), ""
    names = [str(c["name"]) for c in found["columns"]]
    known: set[int] = set()
    for column in (column for given in columns for column in given):
        with suppress(RecordError):  # one that there is not is refused where it is read
            known.add(column_and_unit(names, column)[0])
    left = [c for c in moving_columns(found) if c["number"] not in known]
    chosen, said = list(columns), []
    likely = likely_drive(left, vibration=vibration, driven=[] if columns[0] else None)
    for k, option in enumerate(options):
        if columns[k]:
            continue
        if len(likely[k]) != 1 and not (vibration and k and likely[k]):
            raise _left_open(found, f"which column is the {option}: name it by --{option}")
        chosen[k] = tuple(c["number"] for c in likely[k])
        said.append(f"{option} {', '.join(map(column_label, likely[k]))}")
    driven, follows = chosen
    return driven, follows, f"{'; '.join(said)}: taken by units and names"


def _left_open(found: dict[str, Any], what: str) -> RecordError:
    columns = ", ".join(map(column_label, found["columns"][:20]))
    return RecordError(f"'{found['file']}' leaves open {what} (columns: {columns})")


@dataclass(frozen=True, slots=True, kw_only=True)
class LikelyTurn:
    """The columns of a record of a turn, and what they are likely to be."""

    columns: tuple[str, ...]
    """All columns, by name."""
    angle: str
    """The likely angle."""
    errors: tuple[str, ...]
    """The likely errors, or readings."""
    has_units: bool
    """Whether the file says their units."""
    is_sure: bool
    """Whether one column is called an angle, and others are called errors."""


def likely_turn(found: dict[str, Any]) -> LikelyTurn:
    """Return what columns of a turn are: the angle is the one called so, else the first."""
    columns = {str(c["name"]): c for c in found["columns"]}
    if len(columns) < 2:
        raise RecordError(
            f"'{Path(found['file']).name}' has {len(columns)} column: a record of a turn has the "
            "angle and, for each head, its error"
        )
    called = [n for n in columns if n.casefold().startswith(_ANGLES)]
    angle = (called or list(columns))[0]
    others = [n for n in columns if n != angle and not is_time(columns[n])]
    said = [n for n in others if n.casefold().startswith(_ERRORS)]
    errors = tuple(said or others)
    return LikelyTurn(
        columns=tuple(columns),
        angle=angle,
        errors=errors,
        has_units=all(columns[n]["unit"] for n in (angle, *errors)),
        is_sure=len(called) == 1 and bool(said),
    )


def taken_turn(file: Path, how: ReadOptions) -> tuple[str, tuple[str, ...], str]:
    """Return angle and errors of a record of a turn, and a line that says so."""
    found = contents(*read_whole(file, how))
    turn = likely_turn(found)
    if not turn.is_sure:
        raise _left_open(found, "what is angle and error: name them by --angle and --error")
    said = f"angle {turn.angle}; error {','.join(turn.errors)}: taken by their names"
    return turn.angle, turn.errors, said


def next_job(found: dict[str, Any]) -> str:
    """Return the command that goes on with a file; empty where units and names leave a choice."""
    job = ""
    if found["over"] == "frequency" or "responses" in found:
        job = "frf"
    elif found["over"] == "point":
        turn = likely_turn(found) if len(found["columns"]) > 1 else None
        job = "centre" if turn is not None and turn.is_sure and turn.has_units else ""
    else:
        for name in ("frf", "identify"):
            inputs, outputs = likely_drive(moving_columns(found), vibration=name == "frf")
            if len(inputs) == 1 and (len(outputs) == 1 or (outputs and name == "frf")):
                job = name
    return job
