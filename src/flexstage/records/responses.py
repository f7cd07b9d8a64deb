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
# Zre, ReS11: the quantity is in capitals before or after the word
_JOINED = re.compile(
    rf"(?P<before>[A-Z]{{1,3}}\d{{0,2}})??(?P<word>(?i:{'|'.join(_ROLES)}))(?P<behind>[A-Z]{{1,3}}\d{{0,2}})?"
)
_FREQUENCIES = frozenset(("f", "freq", "frequency", "frequencies", "frequenz", "hz"))
_ANGULAR = frozenset(("omega", "w"))
_SCALES = {"Hz": 1.0, "kHz": 1e3, "MHz": 1e6, "GHz": 1e9, "rad/s": 0.5 / np.pi}
_UNITS = frozenset((*_SCALES, "dB", "deg", "rad"))
_IN_UNITS = frozenset(("db", "deg", "degree", "degrees", "rad", "radian", "radians", "°"))
_PAIRS = (("real", "imaginary"), ("magnitude", "phase"))
_ADVICE = 'give the columns by --response, such as "0,1,2" for frequency, real and imaginary part, \
"0,1 dB,2 deg" for frequency, magnitude and phase'


@dataclass(frozen=True, slots=True, kw_only=True)
class _Part:
    """Column of a response, with its role and the name of the response."""

    channel: Channel
    role: str = ""
    stem: str = ""
    unit: str = ""
    negative: bool = False


def responses_in_columns(record: Record, columns: Sequence[str] | None = None) -> Record:
    """Return a table of frequency responses as a record over frequency.

    Columns are recognised by headings and units: ``frequency (Hz)``, ``H real``, ``Im(H)``, ``Gain
    (dB)``, ``phase_deg``; if a response is there in both forms, the complex one is used.

    Parameters
    ----------
    record : Record
        The table, read as points.
    columns : sequence of str, optional
        Names or numbers of the columns, each followed by its unit if the heading does not state it:
        frequency, then two columns for each response or the name of a complex one; ``["0", "1 dB",
        "2 deg"]``, ``["0", "1 um/V", "2 um/V"]``. The default is real and imaginary part.

    Returns
    -------
    Record
        ``NAME real`` and ``NAME imaginary`` of each response, over rising frequency [Hz].

    Validity
    --------
    Decibels are 20 times the common logarithm. The unit of a phase, degrees or radians, must be
    stated. Headings are English words and their abbreviations.

    Raises
    ------
    RecordError
        There is no column of frequencies or no response, or its form or unit is unknown.

    Examples
    --------
    >>> table = Record(time=np.arange(2.0), over="point", channels=(
    ...     Channel(name="freq", values=np.array([10.0, 20.0]), unit="Hz"),
    ...     Channel(name="Gain (dB)", values=np.array([20.0, 40.0])),
    ...     Channel(name="Phase", values=np.array([np.pi / 2, 0.0]), unit="rad")))
    >>> record = responses_in_columns(table)
    >>> record.time, record.channel("response imaginary").values
    (array([10., 20.]), array([10.,  0.]))
    """
    if columns is None:
        parts = [_part(channel) for channel in record.channels]
        frequency, notes = _frequency(record, parts), []
        pairs = _pairs(record, parts)
    else:
        parts = _selected_parts(record, columns)
        frequency, notes = parts[0], []
        pairs = _in_order(record, parts[1:])
    axis = _hertz(frequency)
    order = slice(None, None, -1) if axis[0] > axis[-1] else slice(None)
    if np.any(np.diff(axis[order]) <= 0.0) or axis.min() < 0.0:
        at = int(np.argmax(np.diff(axis[order]) <= 0.0)) + 1
        raise RecordError(
            f"the frequencies in column '{frequency.channel.name}' must rise, from 0 on, but do "
            f"not at row {at}: read one sweep by the option rows, or select another column"
        )
    channels, attributes = [], dict(record.attributes)
    for name, (first, second) in pairs.items():
        values = _values(record, first, second)
        factor, unit, ends = _unit(name, first, second)
        for role, numbers in (("real", values.real), ("imaginary", values.imag)):
            scaled = np.ascontiguousarray(factor * numbers[order])
            channels.append(Channel(name=f"{name} {role}", values=scaled, unit=unit))
        attributes |= {f"output unit of {name}": ends[0], f"input unit of {name}": ends[1]}
        channels += _quality_channels(parts, name, len(pairs), order, factor)
        if first.role == "magnitude" and _words(first) & {"db"}:
            notes.append(f"'{first.channel.name}' is read as 20 lg of the magnitude")
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
    """Return the role of a column, by its heading."""
    words = [w for w in re.split(r"[^0-9A-Za-zµ°/:+]+", channel.name) if w]
    role, stem = ("magnitude", "") if re.search(r"\|.+\|", channel.name) else ("", "")
    for i, word in enumerate(words):
        match = _JOINED.fullmatch(word)
        if match is not None:
            role = _ROLES[match["word"].lower()]
            joined = [w for w in (match["before"], match["behind"]) if w]
            # "ax/force real": the words before the role are exactly the name
            prefix = channel.name if joined else channel.name.removesuffix(f" {word}")
            other_words = " ".join(_name_words([*words[:i], *joined, *words[i + 1 :]]))
            stem = prefix if prefix != channel.name else other_words
            break
    if role == "magnitude" and not stem:
        stem = " ".join(_name_words([w for w in words if w.lower() not in _ROLES]))
    negative = channel.name.lstrip().startswith(("-", "\N{MINUS SIGN}"))
    return _Part(channel=channel, role=role, stem=stem, unit=unit, negative=negative)


def _name_words(words: Sequence[str]) -> list[str]:
    """Return the words of the name of a response, without those of a unit."""
    return [w for w in words if w and w.lower() not in _IN_UNITS]


def _words(part: _Part) -> set[str]:
    words = re.split(r"[^0-9A-Za-z°]+", f"{part.channel.name} {part.unit}")
    return {word.lower() for word in words}


def _listed(record: Record) -> str:
    names = [f"{i}: {c.name}" for i, c in enumerate(record.channels[:12])]
    return ", ".join(names) + (" and more" if len(record.channels) > 12 else "")


def _frequency(record: Record, parts: Sequence[_Part]) -> _Part:
    frequencies = [p for p in parts if not p.role and _is_frequency(p.channel)]
    if len(frequencies) == 1:
        return frequencies[0]
    count = "no column" if not frequencies else f"{len(frequencies)} columns"
    raise RecordError(
        f"'{record.source}' has {count} of frequencies (columns: {_listed(record)}): for measured "
        f"responses {_ADVICE}; records over time need --input and --output"
    )


def _is_frequency(channel: Channel) -> bool:
    if channel.unit == "Hz":
        return True
    words = {w.lower() for w in re.split(r"[^A-Za-z]+", channel.name) if w}
    names = _ANGULAR | _FREQUENCIES if channel.unit == "rad/s" else _FREQUENCIES
    if channel.unit not in ("", "rad/s"):
        return False
    return bool(words & (names - {"f"})) or channel.name.strip() in ("f", "omega")


def _hertz(part: _Part) -> Array:
    channel = part.channel
    require_complete(channel.values, channel.name)
    if part.unit:
        _require_unsaid(part)
        if part.unit not in _SCALES:
            raise RecordError(
                f"frequencies must be in {', '.join(_SCALES)}, but column '{channel.name}' is in "
                f"'{part.unit}'"
            )
        return channel.values * _SCALES[part.unit]
    if channel.unit == "rad/s" or channel.name.strip() == "omega":
        return channel.values * _SCALES["rad/s"]
    words = re.split(r"[^A-Za-z]+", channel.name)
    return channel.values * next((_SCALES[w] for w in words if w in _SCALES), 1.0)


def _require_unsaid(part: _Part) -> None:
    """Refuse a unit for a column that has one in the file."""
    if part.unit and part.channel.unit:
        raise RecordError(
            f"column '{part.channel.name}' has a unit in the file: omit '{part.unit}'"
        )


def _pairs(record: Record, parts: Sequence[_Part]) -> dict[str, tuple[_Part, _Part]]:
    """Return the two columns of each response: of equal name, or the only ones of their kind."""
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
    why = f"only {', '.join(lone)} of a response" if lone else "no response in a known form"
    raise _no_response(record, f"has {why}")


def _no_response(record: Record, why: str) -> RecordError:
    return RecordError(
        f"'{record.source}' has a column of frequencies, but {why} (columns: {_listed(record)}): "
        f"{_ADVICE}"
    )


def _selected_parts(record: Record, columns: Sequence[str]) -> list[_Part]:
    """Return the selected columns, a complex one as its two parts."""
    names = [c.name for c in record.channels]
    parts = []
    for text in columns:
        name, _, unit = text.strip().rpartition(" ")
        complete = text.strip() in names or f"{text.strip()} real" in names
        if not name or complete or not (unit in _UNITS or _is_unit(unit)):
            name, unit = text.strip(), ""
        if f"{name} real" in names and f"{name} imaginary" in names:
            selectors = [f"{name} real", f"{name} imaginary"]
        else:
            selectors = [name]
        for word in selectors:
            channel = record.channels[column_number(names, word)]
            parts.append(_part(channel, unit))
    if len(parts) < 3 or len(parts) % 2 == 0:
        raise RecordError(
            f"--response has {len(parts)} columns, but needs the frequency, then two for each "
            f"response: {_ADVICE} (columns: {_listed(record)})"
        )
    return parts


def _is_unit(text: str) -> bool:
    """Return whether a text is the unit of a response."""
    try:
        return bool(gravity_unit(text, "acceleration") or measured_unit(text))
    except UnitError:
        return False


def _in_order(record: Record, parts: Sequence[_Part]) -> dict[str, tuple[_Part, _Part]]:
    """Return pairs of columns in the selected order, with their roles."""
    pairs: dict[str, tuple[_Part, _Part]] = {}
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
        if name in pairs:
            name = f"{name} {len(pairs)}"
        pairs[name] = (replace(first, role=kinds[0]), replace(second, role=kinds[1]))
    return pairs


def _values(record: Record, first: _Part, second: _Part) -> NDArray[np.complex128]:
    for part in (first, second):
        require_complete(part.channel.values, part.channel.name)
    if first.role == "real":
        return _signed(first) + 1j * _signed(second)
    decibel = "db" in _words(first)
    magnitude = first.channel.values
    if not decibel and np.any(magnitude < 0.0):
        raise RecordError(
            f"the magnitude in column '{first.channel.name}' is negative: if it is in decibels, "
            f"{_ADVICE}"
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
        f"the phase in column '{part.channel.name}' of '{record.source}' has no unit, deg or rad: "
        f"{_ADVICE} (columns: {_listed(record)})"
    )


def _unit(name: str, *pair: _Part) -> tuple[float, str, tuple[str, str]]:
    """Return the factor and SI unit of a response, and the units of output and input."""
    file_unit = pair[0].channel.unit
    user_units = {part.unit for part in pair} - {"", *_UNITS}
    if not user_units:
        return 1.0, file_unit, _ends(file_unit)
    if file_unit:
        raise RecordError(
            f"the response {name} has the unit {file_unit} in the file: omit {user_units.pop()}"
        )
    if len(user_units) > 1:
        raise RecordError(f"the response {name} has two units: give one")
    text = user_units.pop()
    # no response is of a mass
    factor, unit = gravity_unit(text, "acceleration") or measured_unit(text)
    return factor, unit, _ends(unit)


def _ends(unit: str) -> tuple[str, str]:
    """Return the units of output and input in the unit of a response."""
    quotient = re.fullmatch(r"(.+)/(?:\((.+)\)|([^/()]+))", unit)
    # a velocity and an acceleration are outputs with an unknown input
    if quotient is None or (quotient[3] or "").startswith("s^") or quotient[3] == "s":
        return unit, ""
    return quotient[1], quotient[2] or quotient[3]


def _quality_channels(
    parts: Sequence[_Part], name: str, count: int, order: slice, factor: float
) -> list[Channel]:
    """Return coherence, variance and smearing of neighbouring lines of a response."""
    channels = []
    scales: Mapping[str, float] = {"coherence": 1.0, "variance": factor**2, "blur": 1.0}
    for role, scale in scales.items():
        of_role = [p for p in parts if p.role == role]
        matching = [p for p in of_role if p.stem in (name, name.partition("/")[0])]
        if not matching and len(of_role) == 1 and (count == 1 or not of_role[0].stem):
            matching = of_role
        if matching and np.isfinite(matching[0].channel.values).all():
            values = np.ascontiguousarray(scale * matching[0].channel.values[order])
            channels.append(Channel(name=f"{role} {name}", values=values))
    return channels
