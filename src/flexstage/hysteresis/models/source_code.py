"""Code of a hysteresis model for other programs, in C and MATLAB."""

import functools
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from importlib import resources
from typing import Any

import numpy as np

from flexstage.hysteresis.model import Array, HysteresisModel

_INPUT, _OUTPUT = "V", "m"
_INCLUDE = re.compile(r'^#include "([\w.]+)"', re.MULTILINE)


@dataclass(frozen=True, slots=True, kw_only=True)
class TunableParameter:
    """Parameter of a hysteresis model in C."""

    name: str
    """Its name; an element of a list is ``weights[3]``, counted from 0."""
    unit: str
    """Unit, of a model from volts to metres."""
    index: int | None
    """Place in `HysteresisCode.parameters`; None if tables or the form of the code depend on the
    parameter, so that it cannot be changed at run time.
    """
    value: float
    """Its value."""
    description: str
    """Its description."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class HysteresisCode:
    """Hysteresis model in C.

    ``fs_KIND_move(p, memory, u1)`` returns the output at ``u1``, and ``fs_KIND_line(p, memory, u1,
    pieces, room, &value)`` its pieces on the way there; both update the memory, laid out as the
    state of the model. A line returns -1, with the memory unchanged, if the output is not finite or
    the room is too small.
    """

    kind: str
    """Name of the model in `flexstage.hysteresis.MODELS`."""
    header: str
    """Name of the header."""
    headers: tuple[str, ...]
    """All headers, each after those that it includes."""
    function: str
    """Prefix of the functions, such as ``fs_bouc_wen``."""
    parameters: Array
    """Parameters as arguments of the functions, then tables, shape (n,)."""
    tunable: tuple[TunableParameter, ...]
    """Parameters by name."""
    memory: int
    """Numbers of the memory."""
    pieces: int
    """The largest number of pieces of a line; 0 without a closed form between samples, and without
    ``fs_KIND_line``.
    """


def tunable_of(
    model: HysteresisModel, name: str, index: int | None, description: str, unit: str = ""
) -> TunableParameter:
    """Return a parameter that is one number, or one of a list such as ``weights[3]``.

    The index is None if it cannot be changed at run time. The unit is that of the law by default.
    """
    field, _, places = name.partition("[")
    value = np.asarray(getattr(model, field), dtype=np.float64)
    for place in places.rstrip("]").split(",") if places else ():
        value = value[int(place)]
    return TunableParameter(
        name=name,
        unit=unit or model.units.get(field, "1").format(u=_INPUT, y=_OUTPUT),
        index=index,
        value=float(value),
        description=description,
    )


def code_of(
    model: HysteresisModel,
    parameters: Iterable[float] | Array,
    tunable: Iterable[TunableParameter],
    pieces: int,
    header: str = "",
) -> HysteresisCode:
    """Return the code of a model, with names by its kind, or by a header of several kinds.

    `pieces` is the largest number of pieces of a line; 0 for none.
    """
    name = header.removesuffix(".h") or model.kind.replace("-", "_")
    header = header or f"hysteresis_{name}.h"
    return HysteresisCode(
        kind=model.kind,
        header=header,
        headers=_headers(header),
        function=f"fs_{name}",
        parameters=np.array([float(number) for number in parameters]),
        tunable=tuple(tunable),
        memory=model.initial_state().size,
        pieces=pieces,
    )


@functools.cache
def _headers(header: str) -> tuple[str, ...]:
    """Return a header after all that it includes, each once."""
    headers: dict[str, None] = {}
    for included in _INCLUDE.findall(source_file(header).decode()):
        headers.update(dict.fromkeys(_headers(included)))
    return (*headers, header)


def source_file(name: str) -> bytes:
    """Return a header or a text of MATLAB, from the folder of its model or a common one."""
    models = resources.files("flexstage.hysteresis.models")
    model_file = models / name.removeprefix("hysteresis_").split(".")[0] / name
    return (model_file if model_file.is_file() else models / name).read_bytes()


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MatlabCode:
    """Hysteresis model in MATLAB."""

    parts: tuple[str, ...]
    """Names of its texts: the body of the function, then the functions that it calls."""
    parameters: Mapping[str, tuple[Any, str]]
    """Numbers and descriptions by name."""
