"""Results as plain data, JSON and CSV, by the fields of dataclasses."""

import csv
import io
import json
import math
from collections.abc import Iterable, Mapping
from dataclasses import fields, is_dataclass
from operator import attrgetter
from pathlib import Path
from typing import Any


def plain(value: Any) -> Any:
    """Return a result as plain data: dataclasses as mappings by field, arrays as lists.

    A number that is not finite becomes None, null in JSON; complex numbers become a mapping of
    their real and imaginary parts.

    Examples
    --------
    >>> import numpy as np
    >>> plain({"noise": np.array([1.5, np.inf]), "file": Path("a") / "b.csv"})
    {'noise': [1.5, None], 'file': 'a/b.csv'}
    """
    match value:
        case None | str() | bool() | int():
            return value
        case float():
            return float(value) if math.isfinite(value) else None
        case Path():
            return value.as_posix()
        case Mapping():
            return {key: plain(one) for key, one in value.items()}
        case tuple() | list():
            return [plain(one) for one in value]
    if hasattr(value, "dtype") and value.dtype.kind == "c":
        return {"real": plain(value.real), "imaginary": plain(value.imag)}
    if hasattr(value, "tolist"):  # an array or one of its numbers
        return plain(value.tolist())
    assert is_dataclass(value), f"a {type(value).__name__} has no plain data"
    return {field.name: plain(getattr(value, field.name)) for field in fields(value)}


def picked(source: Any, *names: str) -> dict[str, Any]:
    """Return attributes of a result as plain data, in the order of their names.

    A name may be a path of attributes with dots; a method is called. A different key is written
    before the name, ``key=name``.

    Examples
    --------
    >>> picked(3.5 + 2j, "imag", "whole=real.is_integer")
    {'imag': 2.0, 'whole': False}
    """
    data = {}
    for name in names:
        key, _, path = name.rpartition("=")
        attribute = attrgetter(path)(source)
        data[key or path] = plain(attribute() if callable(attribute) else attribute)
    return data


def json_text(value: Any) -> str:
    """Return plain data as the text of a JSON file."""
    return json.dumps(value, indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def csv_text(rows: Iterable[Iterable[Any]], end: str = "\n") -> str:
    """Return rows as CSV, the heading first.

    Examples
    --------
    >>> csv_text([("name", "x [m]"), ("a, b", 1.5)]).splitlines()
    ['name,x [m]', '"a, b",1.5']
    """
    text = io.StringIO()
    csv.writer(text, lineterminator=end).writerows(rows)
    return text.getvalue()
