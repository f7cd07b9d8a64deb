"""Frequency responses in columns: real and imaginary parts, or magnitudes and phases."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from flexstage.base.arrays import Array
from flexstage.base.errors import RecordError, UnitError
from flexstage.records.columns import gravity_unit, measured_unit
from flexstage.records.record import Channel, Record, column_number
from flexstage.records.sampling import require_complete

_WORDS: dict[str, tuple[str, ...]] = {
    "real": ("real", "re", "realpart"),
    "imaginary": ("imaginary", "imag", "im", "img", "imagpart"),
    "magnitude": ("magnitude", "mag", "amplitude", "abs", "gain", "modulus", "mod"),
    "phase": ("phase", "angle", "arg", "phz", "phi"),
    "coherence": ("coherence", "coh"),
    "variance": ("variance",),
    "blur": ("blur",),
}
_ROLES = {word: role for role, words in _WORDS.items() for word in words}
# Zre, ReS11: what is measured stands in capitals before or behind the word
_JOINED = re.compile(
    rf"(?P<before>[A-Z]{{1,3}}\d{{0,2}})??(?P<word>(?i:{'|'.join(_ROLES)}))(?P<behind>[A-Z]{{1,3}}\d{{0,2}})?"
)
_FREQUENCIES = frozenset(("f", "freq", "frequency", "frequencies", "frequenz", "hz"))
_ANGULAR = frozenset(("omega", "w"))
_SCALES = {"Hz": 1.0, "kHz": 1e3, "MHz": 1e6, "GHz": 1e9, "rad/s": 0.5 / np.pi}
_UNITS = frozenset((*_SCALES, "dB", "deg", "rad"))
_IN_UNITS = frozenset(("db", "deg", "degree", "degrees", "rad", "radian", "radians", "°"))
_PAIRS = (("real", "imaginary"), ("magnitude", "phase"))
_SAID = 'give the columns by --response, such as "0,1,2" for frequency, real and imaginary part, \
"0,1 dB,2 deg" for frequency, magnitude and phase'


@dataclass(frozen=True, slots=True, kw_only=True)
class _Part:
    """A column, what it is of a response, and of which."""

    channel: Channel
    role: str = ""
    stem: str = ""
    unit: str = ""
    negative: bool = False


def responses_in_columns(record: Record, columns: Sequence[str] | None = None) -> Record:
    """Return a table of frequency responses as a record over frequency.

    Columns are told by their headings and units: ``frequency (Hz)``, ``H real``, ``Im(H)``,
    ``Gain (dB)``, ``phase_deg``; of a response that stands there twice the complex one is taken.

    Parameters
    ----------
    record : Record
        The table, read as points.
    columns : sequence of str, optional
        Names or numbers of the columns, each with its unit behind it where the heading does not
        say it: frequency, then two columns for each response or the name of a complex one;
        ``["0", "1 dB", "2 deg"]``, ``["0", "1 um/V", "2 um/V"]``. Real and imaginary part, where
        they do not say otherwise.

    Returns
    -------
    Record
        ``NAME real`` and ``NAME imaginary`` of each response, over rising frequency [Hz].

    Validity
    --------
    Decibels are 20 times the common logarithm. Whether a phase is in degrees or radians is not
    guessed. Headings are of English words and their short forms.

    Raises
    ------
    RecordError
        There is no column of frequencies or no response, or its form or unit is not said.

    Examples
    --------
    >>> table = Record(time=np.arange(2.0), over="point", channels=(
    ...     Channel(name="freq", values=np.array([10.0, 20.0]), unit="Hz"),
    ...     Channel(name="Gain (dB)", values=np.array([20.0, 40.0])),
    ...     Channel(name="Phase", values=np.array([np.pi / 2, 0.0]), unit="rad")))
    >>> found = responses_in_columns(table)
    >>> found.time, found.channel("response imaginary").values
    (array([10., 20.]), array([10.,  0.]))
    """
    if columns is None:
        parts = [_part(channel) for channel in record.channels]
        frequency, notes = _frequency(record, parts), []
        pairs = _pairs(record, parts)
    else:
        parts = _asked(record, columns)
        frequency, notes = parts[0], []
        pairs = _in_order(record, parts[1:])
    axis = _hertz(frequency)
    order = slice(None, None, -1) if axis[0] > axis[-1] else slice(None)
    if np.any(np.diff(axis[order]) <= 0.0) or axis.min() < 0.0:
        at = int(np.argmax(np.diff(axis[order]) <= 0.0)) + 1
        raise RecordError(
            f"the frequencies in column '{frequency.channel.name}' must rise, from 0 on, and do "
            f"not at row {at}: read one sweep by the option rows, or choose another column"
        )
    channels, attributes = [], dict(record.attributes)
    for name, (first, second) in pairs.items():
        values = _values(record, first, second)
        factor, unit, ends = _unit(name, first, second)
        for role, numbers in (("real", values.real), ("imaginary", values.imag)):
            scaled = np.ascontiguousarray(factor * numbers[order])
            channels.append(Channel(name=f"{name} {role}", values=scaled, unit=unit))
        attributes |= {f"output unit of {name}": ends[0], f"input unit of {name}": ends[1]}
        channels += _beside(parts, name, len(pairs), order, factor)
        if first.role == "magnitude" and _words(first) & {"db"}:
            notes.append(f"'{first.channel.name}' is taken as 20 lg of the magnitude")
    return replace(
        record,
        channels=tuple(channels),
        time=np.ascontiguousarray(axis[order]),
        over="frequency",
        attributes=attributes,
        notes=(*record.notes, f"responses: {', '.join(pairs)}", *notes),
        numbers=None,
    )


def _part(channel: Channel, unit: str = "") -> _Part:
    """Return what a column is, by its heading."""
    words = [w for w in re.split(r"[^0-9A-Za-zµ°/:+]+", channel.name) if w]
    role, stem = ("magnitude", "") if re.search(r"\|.+\|", channel.name) else ("", "")
    for i, word in enumerate(words):
        found = _JOINED.fullmatch(word)
        if found is not None:
            role = _ROLES[found["word"].lower()]
            joined = [w for w in (found["before"], found["behind"]) if w]
            # "ax/force real": the words in front are the name, to the letter
            whole = channel.name if joined else channel.name.removesuffix(f" {word}")
            kept = " ".join(_named([*words[:i], *joined, *words[i + 1 :]]))
            stem = whole if whole != channel.name else kept
            break
    if role == "magnitude" and not stem:
        stem = " ".join(_named([w for w in words if w.lower() not in _ROLES]))
    negative = channel.name.lstrip().startswith(("-", "\N{MINUS SIGN}"))
    return _Part(channel=channel, role=role, stem=stem, unit=unit, negative=negative)


def _named(words: Sequence[str]) -> list[str]:
    """Return the words that name a response: not those of a unit."""
    return [w for w in words if w and w.lower() not in _IN_UNITS]


def _words(part: _Part) -> set[str]:
    found = re.split(r"[^0-9A-Za-z°]+", f"{part.channel.name} {part.unit}")
    return {word.lower() for word in found}


def _listed(record: Record) -> str:
    names = [f"{i}: {c.name}" for i, c in enumerate(record.channels[:12])]
    return ", ".join(names) + (" and more" if len(record.channels) > 12 else "")


def _frequency(record: Record, parts: Sequence[_Part]) -> _Part:
    found = [p for p in parts if not p.role and _is_frequency(p.channel)]
    if len(found) == 1:
        return found[0]
    count = "no column" if not found else f"{len(found)} columns"
    raise RecordError(
        f"'{record.source}' has {count} of frequencies (columns: {_listed(record)}): of measured "
        f"responses {_SAID}; records over time need --input and --output"
    )


def _is_frequency(channel: Channel) -> bool:
    if channel.unit == "Hz":
        return True
    words = {w.lower() for w in re.split(r"[^A-Za-z]+", channel.name) if w}
    known = _ANGULAR | _FREQUENCIES if channel.unit == "rad/s" else _FREQUENCIES
    if channel.unit not in ("", "rad/s"):
        return False
    return bool(words & (known - {"f"})) or channel.name.strip() in ("f", "omega")


def _hertz(part: _Part) -> Array:
    channel = part.channel
    require_complete(channel.values, channel.name)
    if part.unit:
        _require_unsaid(part)
        if part.unit not in _SCALES:
            raise RecordError(
                f"frequencies are in {', '.join(_SCALES)}, and '{part.unit}' stands behind column "
                f"'{channel.name}'"
            )
        return channel.values * _SCALES[part.unit]
    if channel.unit == "rad/s" or channel.name.strip() == "omega":
        return channel.values * _SCALES["rad/s"]
    words = re.split(r"[^A-Za-z]+", channel.name)
    return channel.values * next((_SCALES[w] for w in words if w in _SCALES), 1.0)


def _require_unsaid(part: _Part) -> None:
    """Refuse a unit that is given to a column that says its own."""
    if part.unit and part.channel.unit:
        raise RecordError(f"column '{part.channel.name}' says its unit: leave '{part.unit}' out")


def _pairs(record: Record, parts: Sequence[_Part]) -> dict[str, tuple[_Part, _Part]]:
    """Return the two columns of each response: of one name, or the only ones of their kind."""
    for kinds in _PAIRS:
        firsts, seconds = ([p for p in parts if p.role == kind] for kind in kinds)
        if len(firsts) == len(seconds) == 1:
            matched = [(firsts[0], seconds[0])]
        else:
            matched = [(a, b) for a in firsts for b in seconds if a.stem == b.stem]
        if len({a.stem for a, _ in matched}) < len(matched):
            raise _no_response(record, "has several columns of the same name")
        if matched:
            return {a.stem or b.stem or "response": (a, b) for a, b in matched}
    lone = [p.channel.name for p in parts if p.role in ("real", "imaginary", "magnitude", "phase")]
    held = f"holds only {', '.join(lone)} of a response" if lone else "does not say its form"
    raise _no_response(record, held)


def _no_response(record: Record, why: str) -> RecordError:
    return RecordError(
        f"'{record.source}' has a column of frequencies, and {why} (columns: {_listed(record)}): "
        f"{_SAID}"
    )


def _asked(record: Record, columns: Sequence[str]) -> list[_Part]:
    """Return the columns that were asked for, a complex one as its two parts."""
    names = [c.name for c in record.channels]
    parts = []
    for text in columns:
        name, _, unit = text.strip().rpartition(" ")
        whole = text.strip() in names or f"{text.strip()} real" in names
        if not name or whole or not (unit in _UNITS or _is_unit(unit)):
            name, unit = text.strip(), ""
        if f"{name} real" in names and f"{name} imaginary" in names:
            wanted = [f"{name} real", f"{name} imaginary"]
        else:
            wanted = [name]
        for word in wanted:
            channel = record.channels[column_number(names, word)]
            parts.append(_part(channel, unit))
    if len(parts) < 3 or len(parts) % 2 == 0:
        raise RecordError(
            f"--response names {len(parts)} columns, and needs the frequency, then two for each "
            f"response: {_SAID} (columns: {_listed(record)})"
        )
    return parts


def _is_unit(text: str) -> bool:
    """Say whether a text is the unit of a response."""
    try:
        return bool(gravity_unit(text, "acceleration") or measured_unit(text))
    except UnitError:
        return False


def _in_order(record: Record, parts: Sequence[_Part]) -> dict[str, tuple[_Part, _Part]]:
    """Return pairs of columns as they were asked for, with what they are."""
    found: dict[str, tuple[_Part, _Part]] = {}
    for first, second in zip(parts[::2], parts[1::2], strict=True):
        polar = (
            second.unit in ("deg", "rad")
            or second.channel.unit == "rad"
            or second.role == "phase"
            or first.role == "magnitude"
            or first.unit == "dB"
        )
        kinds = _PAIRS[1] if polar else _PAIRS[0]
        name = first.stem or (first.channel.name if not first.role else "") or "response"
        if name in found:
            name = f"{name} {len(found)}"
        found[name] = (replace(first, role=kinds[0]), replace(second, role=kinds[1]))
    return found


def _values(record: Record, first: _Part, second: _Part) -> NDArray[np.complex128]:
    for part in (first, second):
        require_complete(part.channel.values, part.channel.name)
    if first.role == "real":
        return _signed(first) + 1j * _signed(second)
    decibel = "db" in _words(first)
    magnitude = first.channel.values
    if not decibel and np.any(magnitude < 0.0):
        raise RecordError(
            f"the magnitude in column '{first.channel.name}' is negative: where it is in decibels, "
            f"{_SAID}"
        )
    size = np.power(10.0, magnitude / 20.0) if decibel else magnitude
    return np.asarray(size * np.exp(1j * _radians(record, second)), dtype=np.complex128)


def _signed(part: _Part) -> Array:
    return -part.channel.values if part.negative else part.channel.values


def _radians(record: Record, part: _Part) -> Array:
    values, words = _signed(part), _words(part)
    if part.channel.unit == "rad":
        _require_unsaid(part)
        return values
    if words & {"deg", "degree", "degrees", "°"}:
        return np.radians(values)
    if words & {"rad", "radian", "radians"}:
        return values
    raise RecordError(
        f"column '{part.channel.name}' of '{record.source}' does not say whether its phase is in "
        f"deg or rad: {_SAID} (columns: {_listed(record)})"
    )


def _unit(name: str, *pair: _Part) -> tuple[float, str, tuple[str, str]]:
    """Return by what a response is multiplied, its SI unit, and those of output and input."""
    own = pair[0].channel.unit
    said = {part.unit for part in pair} - {"", *_UNITS}
    if not said:
        return 1.0, own, _ends(own)
    if own:
        raise RecordError(f"the response {name} says its unit, {own}: leave {said.pop()} out")
    if len(said) > 1:
        raise RecordError(f"the response {name} is given two units: give one")
    text = said.pop()
    # no response is of a mass
    factor, unit = gravity_unit(text, "acceleration") or measured_unit(text)
    return factor, unit, _ends(unit)


def _ends(unit: str) -> tuple[str, str]:
    """Return the units of output and input of which one is that of a response."""
    found = re.fullmatch(r"(.+)/(?:\((.+)\)|([^/()]+))", unit)
    # a speed and an acceleration are outputs whose input is not said
    if found is None or (found[3] or "").startswith("s^") or found[3] == "s":
        return unit, ""
    return found[1], found[2] or found[3]


def _beside(
    parts: Sequence[_Part], name: str, count: int, order: slice, factor: float
) -> list[Channel]:
    """Return coherence and variance of a response, and how far neighbouring lines are mixed."""
    found = []
    scales: Mapping[str, float] = {"coherence": 1.0, "variance": factor**2, "blur": 1.0}
    for role, scale in scales.items():
        own = [p for p in parts if p.role == role]
        mine = [p for p in own if p.stem in (name, name.partition("/")[0])]
        if not mine and len(own) == 1 and (count == 1 or not own[0].stem):
            mine = own
        if mine and np.isfinite(mine[0].channel.values).all():
            values = np.ascontiguousarray(scale * mine[0].channel.values[order])
            found.append(Channel(name=f"{role} {name}", values=values))
    return found
