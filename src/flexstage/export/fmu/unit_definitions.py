"""Units of an FMU's variables, by the exponents of the base units."""

import re

_BASES = ("kg", "m", "s", "A", "K", "mol", "cd", "rad")
# exponents of kg, m, s, A; then K and rad where they are not 0
_KNOWN: dict[str, dict[str, int]] = {
    "1": {},
    "V": {"kg": 1, "m": 2, "s": -3, "A": -1},
    "N": {"kg": 1, "m": 1, "s": -2},
    "Hz": {"s": -1},
    "F": {"kg": -1, "m": -2, "s": 4, "A": 2},
    "Pa": {"kg": 1, "m": -1, "s": -2},
    "J": {"kg": 1, "m": 2, "s": -2},
    **{base: {base: 1} for base in _BASES},
}
_PREFIXES = {"n": 1e-9, "u": 1e-6, "µ": 1e-6, "μ": 1e-6, "m": 1e-3, "k": 1e3, "M": 1e6}
_FACTOR = re.compile(r"(?P<unit>[A-Za-zµμ]+|1)\^?(?P<power>-?[0-9.]+)?")


def base_units(unit: str) -> dict[str, float] | None:
    """Return the exponents of kg, m, s, A, K, mol, cd, rad in a unit that are not 0.

    A unit has powers, spaces and one ``/``: ``m/V^2``, ``1/(V m)``. ``factor`` is there where a
    prefix makes it another than 1. None where there are no such whole exponents.

    Examples
    --------
    >>> base_units("m/V"), base_units("Hz"), base_units("um")
    ({'kg': -1, 'm': -1, 's': 3, 'A': 1}, {'s': -1}, {'m': 1, 'factor': 1e-06})
    >>> base_units("1/(V m^0.5)") is None
    True
    """
    above, _, below = unit.partition("/")
    total: dict[str, float] = {}
    factor = 1.0
    for text, sign in ((above, 1), (below, -1)):
        for part in text.strip().strip("()").replace("*", " ").replace(".", " .").split():
            found = _FACTOR.fullmatch(part)
            if found is None:
                return None
            power = sign * float(found["power"] or 1.0)
            exponents, scale = _exponents(found["unit"])
            if exponents is None or power != int(power):
                return None
            factor *= scale**power
            for base, value in exponents.items():
                total[base] = total.get(base, 0) + int(power) * value
    out: dict[str, float] = {base: total[base] for base in _BASES if total.get(base)}
    return out if factor == 1.0 else {**out, "factor": factor}


def _exponents(unit: str) -> tuple[dict[str, int] | None, float]:
    if unit in _KNOWN:
        return _KNOWN[unit], 1.0
    if unit[:1] in _PREFIXES and unit[1:] in _KNOWN and unit[1:] not in ("1", "kg"):
        return _KNOWN[unit[1:]], _PREFIXES[unit[0]]
    return None, 1.0
