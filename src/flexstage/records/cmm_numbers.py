"""Numbers as reports of coordinate measuring machines print them, with either decimal sign."""

import re
from collections.abc import Iterable

from flexstage.errors import RecordError

_BODY = re.compile(r"[+-]?([0-9.,]*[0-9][.,]?)([eE][+-]?\d+)?")
# what divides thousands without being a decimal sign anywhere
_SPACES = re.compile("(?<=[0-9])[\u00a0\u2009\u202f '\u2019](?=[0-9]{3}(?![0-9]))")
_OTHER = {".": ",", ",": "."}


def decimal_sign(numbers: Iterable[tuple[int, str]], given: str | None = None) -> str:
    """Return the decimal sign of numbers in a text, each with the number of its line.

    ``0,025`` and ``10,0012`` can only have a decimal comma, ``1,234.5`` only a decimal point;
    ``1,234`` may be either.

    Examples
    --------
    >>> decimal_sign([(1, "10,000"), (2, "0,012")])
    ','
    """
    if given is not None:
        if given not in _OTHER:
            raise RecordError(f"the decimal sign must be '.' or ',', got {given!r}")
        return given
    proofs: dict[str, tuple[int, str]] = {}
    open_: dict[str, tuple[int, str]] = {}
    for line, text in numbers:
        sign, sure = _shown(_SPACES.sub("", text))
        if sign:
            (proofs if sure else open_).setdefault(sign, (line, text))
    if len(proofs) == 2:
        (a, first), (b, second) = proofs["."], proofs[","]
        raise RecordError(
            f"'{first}' in line {a} has a decimal point, '{second}' in line {b} a decimal comma: "
            "export the file with one sign"
        )
    for sign in proofs:
        if _OTHER[sign] in open_:
            line, text = open_[_OTHER[sign]]
            raise RecordError(
                f"line {line}: '{text}' may be in thousands or have another decimal sign than the "
                "other numbers: export the file with one sign, or give the option decimal"
            )
        return sign
    if "," in open_:
        line, text = open_[","]
        raise RecordError(
            f"line {line}: the comma in '{text}' may be decimal or divide thousands, and no number "
            "of the file tells: give the option decimal"
        )
    return "."


def _shown(text: str) -> tuple[str, bool]:
    """Return the decimal sign that a number shows, if any, and whether it can be nothing else."""
    found = _BODY.fullmatch(text)
    if found is None:
        return "", False
    body, exponent = found[1], found[2]
    last = next((c for c in reversed(body) if c in _OTHER), "")
    if not last:
        return "", False
    if _OTHER[last] in body:
        return last, True
    if body.count(last) > 1:
        return _OTHER[last], True
    whole, _, decimals = body.partition(last)
    thousands = len(decimals) == 3 and re.fullmatch(r"[1-9]\d{0,2}", whole) is not None
    return last, not thousands or exponent is not None


def printed_number(text: str, sign: str, where: str) -> float:
    """Return a number as printed; the other sign may divide thousands. `where` is for the message.

    Examples
    --------
    >>> printed_number("-1.234,5", ",", "line 3")
    -1234.5
    """
    plain = _SPACES.sub("", text.strip())
    other = re.escape(_OTHER[sign])
    point = re.escape(sign)
    whole = rf"[1-9]\d{{0,2}}(?:{other}\d{{3}})+|\d*"
    grouped = re.fullmatch(rf"([+-]?)({whole})(?:{point}(\d*))?([eE][+-]?\d{{1,3}})?", plain)
    if grouped is None or not (grouped[2] or grouped[3]):
        raise RecordError(
            f"{where}: '{text.strip()[:30]}' is not a number with the decimal sign '{sign}': "
            "correct it, or give the option decimal"
        )
    digits = grouped[2].replace(_OTHER[sign], "")
    return float(f"{grouped[1]}{digits or '0'}.{grouped[3] or '0'}{grouped[4] or ''}")


def is_difference(deviation: str, measured: str, nominal: str, sign: str) -> bool:
    """Say whether a deviation is measured minus nominal, as far as the digits tell.

    Its negative counts too: some machines count deviations away from zero.

    Examples
    --------
    >>> is_difference("0,012", "10,0124", "10,000", ","), is_difference("0,2", "10,0", "10,0", ",")
    (True, False)
    """
    texts = (deviation, measured, nominal)
    found, a, b = (printed_number(text, sign, "deviation") for text in texts)
    # each of the three is rounded to its own last digit
    digits = sum(0.5 * _last_digit(text, sign) for text in texts)
    return abs(abs(found) - abs(a - b)) <= 1.05 * digits + 1e-12 * max(abs(a), abs(b))


def _last_digit(text: str, sign: str) -> float:
    """Return what one step of the last digit of a number is."""
    mantissa, _, exponent = text.lower().partition("e")
    decimals = len(mantissa.rpartition(sign)[2]) if sign in mantissa else 0
    return 10.0 ** (int(exponent or 0) - decimals)
