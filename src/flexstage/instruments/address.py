"""Options in the address of an instrument, ``gcs://HOST:PORT?OPTIONS``, read alike by all."""

from collections.abc import Mapping
from urllib.parse import SplitResult, parse_qsl

from flexstage.errors import ModelError

_YES_OR_NO = {"1": True, "yes": True, "true": True, "0": False, "no": False, "false": False}


def options_of(address: str, parts: SplitResult, known: tuple[str, ...]) -> dict[str, str]:
    """Return the options of an address; refuse those that its kind has not, and doubled ones."""
    pairs = parse_qsl(parts.query, keep_blank_values=True)
    for key, _ in pairs:
        if key not in known:
            there = f"are {', '.join(known)}" if known else "is none for this kind of address"
            raise ModelError(f"'{address}' has the option '{key}', and there {there}")
    if len(dict(pairs)) < len(pairs):
        raise ModelError(f"'{address}' names an option twice: leave one out")
    return dict(pairs)


def number(
    options: Mapping[str, str], key: str, usual: float, address: str, *, whole: bool = False
) -> float:
    """Return an option that is a number from 0."""
    text = options.get(key)
    if text is None:
        return usual
    try:
        value = float(int(text)) if whole else float(text)
    except (ValueError, OverflowError):
        value = -1.0
    if not 0.0 <= value < float("inf"):
        raise ModelError(
            f"'{key}' of '{address}' must be a {'whole ' if whole else ''}number from 0, got "
            f"'{text}'"
        )
    return value


def flag(options: Mapping[str, str], key: str, usual: bool, address: str) -> bool:
    """Return an option that is 1 or 0."""
    text = options.get(key)
    if text is None:
        return usual
    if text.lower() not in _YES_OR_NO:
        raise ModelError(f"'{key}' of '{address}' must be 1 or 0, got '{text}'")
    return _YES_OR_NO[text.lower()]


def one_of(options: Mapping[str, str], key: str, known: tuple[str, ...], address: str) -> str:
    """Return an option that is one of some words, the first of which is usual."""
    text = options.get(key, known[0])
    if text not in known:
        raise ModelError(f"'{key}' of '{address}' must be {' or '.join(known)}, got '{text}'")
    return text


def longest_silence(timeout: float | None, usual: float = 2.0) -> float:
    """Return a time after which an answer is given up [s]."""
    if timeout is None:
        return usual
    if not 0.0 < timeout < float("inf"):
        raise ModelError(f"the time-out must be positive and finite, got {timeout!r} s")
    return timeout
