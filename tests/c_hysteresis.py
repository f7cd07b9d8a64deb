"""The hysteresis models as C, compiled and loaded; and models with generic parameters."""

import ctypes
import functools
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexstage.hysteresis import (
    AsymmetricBoucWen,
    BoucWen,
    Dahl,
    Duhem,
    GeneralisedBoucWen,
    GeneralisedMaxwellSlip,
    ModifiedPrandtlIshlinskii,
    PrandtlIshlinskii,
    Preisach,
)
from flexstage.hysteresis.model import HysteresisModel, Segments
from flexstage.hysteresis.models.registry import hysteresis_code
from flexstage.hysteresis.models.source_code import HysteresisCode, source_file
from tests.c_compiler import EXACT, load_library
from tests.hysteresis_vectors import VECTORS

#: Numbers in double or single precision.
Array = NDArray[Any]

_MOVES = """
#include <stdlib.h>
#include "{header}"
void moves(const fs_real *p, fs_real *memory, const fs_real *u, int n, fs_real *y)
{{
    int i;
    for (i = 0; i < n; i++)
        y[i] = {function}_move(p, memory, u[i]);
}}
"""
_LINES = """
int line(const fs_real *p, fs_real *memory, fs_real u, fs_real *pieces, int room, fs_real *y)
{{
    return {function}_line(p, memory, u, (fs_piece *)pieces, room, y);
}}
void lines(const fs_real *p, fs_real *memory, const fs_real *u, int n, fs_real *y, int room)
{{
    fs_piece *pieces = malloc((size_t)room * sizeof *pieces);
    int i;
    for (i = 0; i < n; i++)
        if ({function}_line(p, memory, u[i], pieces, room, y + i) < 1)
            y[i] = (fs_real)NAN;
    free(pieces);
}}
"""


def program(code: HysteresisCode) -> str:
    """Return C that steps a model through a sequence."""
    names = {"header": code.header, "function": code.function}
    return _MOVES.format(**names) + (_LINES.format(**names) if code.pieces else "")


def headers(code: HysteresisCode) -> dict[str, bytes]:
    """Return the headers that a model needs, and no others."""
    return {name: source_file(name) for name in code.headers}


@functools.cache
def _library(source: str, kind: str, single: bool) -> ctypes.CDLL:
    code = hysteresis_code(next(m for m in CASES.values() if m.kind == kind))
    flags = (*EXACT, "-DFS_SINGLE", "-Wdouble-promotion") if single else EXACT
    with tempfile.TemporaryDirectory() as folder:
        # A loaded library needs its file no longer.
        return load_library(Path(folder), source, files=headers(code), flags=flags)


@dataclass
class Compiled:
    """A model in C with its memory."""

    model: HysteresisModel
    single: bool = False

    def __post_init__(self) -> None:
        self.code = hysteresis_code(self.model)
        self.library = _library(program(self.code), self.code.kind, self.single)
        self.type: Any = np.float32 if self.single else np.float64
        self.parameters = self.code.parameters.astype(self.type)
        self.memory = self.model.initial_state().astype(self.type)

    def moves(self, u: Array) -> Array:
        """Return the outputs for a sequence."""
        return self._through("moves", u)

    def lines(self, u: Array) -> Array:
        """Return the outputs at the ends of lines."""
        return self._through("lines", u, self.code.pieces)

    def line(self, u: float, room: int | None = None) -> tuple[int, Array, float]:
        """Return the number of pieces of a line, the pieces (m, 5), and the output at its end."""
        asked = self.code.pieces if room is None else room
        pieces = np.full((max(asked, 1), 5), np.nan, dtype=self.type)
        value = np.full(1, np.nan, dtype=self.type)
        real = ctypes.c_float if self.single else ctypes.c_double
        count = self.library.line(
            _pointer(self.parameters), _pointer(self.memory), real(u), _pointer(pieces), asked,
            _pointer(value),
        )  # fmt: skip
        return count, pieces[: max(count, 0)], float(value[0])

    def _through(self, function: str, u: Array, *room: int) -> Array:
        inputs = np.ascontiguousarray(u, dtype=self.type)
        values = np.empty_like(inputs)
        getattr(self.library, function)(
            _pointer(self.parameters), _pointer(self.memory), _pointer(inputs), inputs.size,
            _pointer(values), *room,
        )  # fmt: skip
        return values


def _pointer(array: Array) -> ctypes.c_void_p:
    assert array.flags.c_contiguous
    return ctypes.c_void_p(array.ctypes.data)


def table(segments: Segments) -> Array:
    """Return pieces as C returns them, shape (m, 5)."""
    return np.stack(segments.arrays, axis=1)


def walk(seed: int, count: int, low: float = -31.0, high: float = 139.0) -> Array:
    """Random inputs: lines, jumps, steps of nothing, tiny and huge ones, exact reversals."""
    return _walk(seed, count, low, high).copy()


@functools.cache
def _walk(seed: int, count: int, low: float, high: float) -> Array:
    rng = np.random.default_rng(seed)
    u = np.empty(count)
    here, way = 0.0, 1.0
    marks = [0.0]
    for i in range(count):
        kind = rng.integers(0, 10)
        if kind == 0:
            here = rng.uniform(low, high)
        elif kind == 1:
            pass
        elif kind == 2:
            here = float(np.nextafter(here, here + way))
        elif kind == 3:
            # back to where it has been, exactly
            here, way = marks[rng.integers(0, len(marks))], -way
        elif kind == 4:
            here += way * 10.0 ** rng.uniform(-14.0, -2.0)
        else:
            here += way * rng.exponential(1.7)
        if rng.random() < 0.05:
            way = -way
            marks = [*marks[-20:], here]
        if not low <= here <= high:
            here, way = min(max(here, low), high), -way
        u[i] = here
    return u


def preisach(seed: int, plays: int, intervals: int) -> Preisach:
    """Return a Preisach model with random numbers."""
    rng = np.random.default_rng(seed)
    return Preisach(
        thresholds=np.concatenate([[0.0], np.sort(rng.uniform(0.4, 71.0, plays - 1))]),
        knots=np.sort(rng.uniform(-29.0, 133.0, intervals + 1)),
        slopes=rng.uniform(0.0, 0.5e-6 / plays, size=(plays, intervals)),
        gain=0.13e-6,
    )


def prandtl(seed: int, plays: int) -> PrandtlIshlinskii:
    """Return a Prandtl-Ishlinskii model with random numbers."""
    rng = np.random.default_rng(seed)
    return PrandtlIshlinskii(
        gain=0.29e-6,
        thresholds=np.sort(rng.uniform(0.3, 60.0, plays)),
        weights=rng.uniform(0.0, 0.6e-6 / plays, plays),
    )


def modified(seed: int, plays: int) -> ModifiedPrandtlIshlinskii:
    """Return a modified Prandtl-Ishlinskii model with random plays."""
    inner = prandtl(seed, plays)
    return ModifiedPrandtlIshlinskii(
        gain=inner.gain,
        thresholds=inner.thresholds,
        weights=inner.weights,
        dead_zones=np.array([-7.3e-6, -1.9e-6, 11e-6, 29e-6, 47e-6]),
        dead_zone_weights=np.array([0.3, 0.25, -0.15, -0.3, 0.22]),
    )


def maxwell(seed: int, elements: int, bent: bool) -> GeneralisedMaxwellSlip:
    """Return a Maxwell-slip model with random elements."""
    rng = np.random.default_rng(seed)
    zones = {
        "dead_zones": np.array([-4e-6, 9e-6, 17e-6, 33e-6]),
        "dead_zone_weights": np.array([0.4e6, 0.21e6, -0.3e6, 0.25e6]),
    }
    return GeneralisedMaxwellSlip(
        stiffness=1.6e6,
        thresholds=np.sort(rng.uniform(0.2e-6, 22e-6, elements)),
        element_stiffness=rng.uniform(0.0, 1.1e6 / elements, elements),
        **(zones if bent else {}),
    )


def bouc_wen(n: float, beta: float = 0.047, gamma: float = 0.031) -> BoucWen:
    """Return a Bouc-Wen model whose saturation does not depend on its exponent."""
    scale = 5.3e-6 ** (1.0 - n)
    return BoucWen(
        gain=0.593e-6,
        hysteresis_gain=0.241e-6,
        beta=beta * scale,
        gamma=gamma * scale,
        exponent=n,
    )


def asymmetric(n: float) -> AsymmetricBoucWen:
    """Return an asymmetric Bouc-Wen model."""
    law = bouc_wen(n)
    return AsymmetricBoucWen(
        gain=0.57e-6, quadratic=4e-10, cubic=-1.1e-12, hysteresis_gain=law.hysteresis_gain,
        beta=law.beta, gamma=law.gamma, lowest_input=-31.0, highest_input=139.0, exponent=n,
    )  # fmt: skip


def generalised(n: float) -> GeneralisedBoucWen:
    """Return a generalised Bouc-Wen model."""
    scale = 5.3e-6 ** (1.0 - n)
    shape = (0.05, 0.006, 0.002, 0.003, -0.001, 0.004)
    return GeneralisedBoucWen(
        gain=0.593e-6, hysteresis_gain=0.261e-6, centre=57.3, exponent=n,
        shape=tuple(b * scale for b in shape),
    )  # fmt: skip


def duhem(curve: list[float], tangent: list[float]) -> Duhem:
    """Return a Duhem model."""
    return Duhem(
        rate=0.043,
        anhysteretic=np.array(curve),
        tangent=np.array(tangent),
        input_range=(-31.0, 139.0),
    )


#: Models of every kind, with generic parameters.
CASES: dict[str, HysteresisModel] = {
    "bouc-wen n=1": bouc_wen(1.0),
    "bouc-wen n=1, gamma above beta": bouc_wen(1.0, 0.031, 0.047),
    "bouc-wen n=1, gamma below zero": bouc_wen(1.0, 0.061, -0.019),
    "bouc-wen n=1, beta = gamma": bouc_wen(1.0, 0.041, 0.041),
    "bouc-wen n=1, beta = -gamma": bouc_wen(1.0, 0.041, -0.041),
    "bouc-wen n=1.0003": bouc_wen(1.0003),
    "bouc-wen n=1.4": bouc_wen(1.4),
    "bouc-wen n=1.9, gamma above beta": bouc_wen(1.9, 0.031, 0.047),
    "bouc-wen n=2": bouc_wen(2.0),
    "bouc-wen n=2, gamma above beta": bouc_wen(2.0, 0.031, 0.047),
    "bouc-wen n=3.7": bouc_wen(3.7, 0.061, -0.019),
    "bouc-wen n=1.6, beta = gamma": bouc_wen(1.6, 0.041, 0.041),
    "asymmetric-bouc-wen n=1": asymmetric(1.0),
    "asymmetric-bouc-wen n=1.7": asymmetric(1.7),
    "asymmetric-bouc-wen n=2": asymmetric(2.0),
    "generalised-bouc-wen n=1": generalised(1.0),
    "generalised-bouc-wen n=1.3": generalised(1.3),
    "generalised-bouc-wen n=2": generalised(2.0),
    "dahl i=1": Dahl(gain=0.593e-6, stiffness=0.251e-6, limit=5.3e-6),
    "dahl i=1.4": Dahl(gain=0.593e-6, stiffness=0.251e-6, limit=5.3e-6, exponent=1.4),
    "dahl i=0.6": Dahl(gain=0.593e-6, stiffness=0.251e-6, limit=5.3e-6, exponent=0.6),
    "dahl i=2": Dahl(gain=0.593e-6, stiffness=0.251e-6, limit=5.3e-6, exponent=2.0),
    "duhem straight": duhem([1.1e-6, 0.47e-6], [0.34e-6]),
    "duhem curved": duhem([1.1e-6, 0.47e-6, 0.9e-9, -4e-12], [0.34e-6, 0.3e-9, 2e-13, 1e-15]),
    "prandtl-ishlinskii 4": prandtl(3, 4),
    "prandtl-ishlinskii 23": prandtl(4, 23),
    "modified-prandtl-ishlinskii": modified(7, 6),
    "maxwell-slip": maxwell(5, 5, bent=False),
    "maxwell-slip bent": maxwell(6, 7, bent=True),
    "preisach 6 x 5": preisach(5, 6, 5),
    "preisach 3 x 1": preisach(6, 3, 1),
    "preisach 31 x 12": preisach(8, 31, 12),
    **{f"{name}, of its vector": vector.model for name, vector in VECTORS.items()},
}
