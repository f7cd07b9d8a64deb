"""The C of a dynamic model, compiled and stepped; and Python stepped one sample at a time."""

import ctypes
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexstage.base.arrays import Array
from flexstage.export.source.render import c_variables, render_source
from flexstage.hysteresis.dynamic_model import DynamicModel, ModelState
from tests.c_compiler import EXACT, load_library

_WRAPPED = """
#include "stage.h"
#include <string.h>
size_t size(void) { return sizeof(fs_stage); }
void init(fs_stage *s) { fs_init(s); }
const char *prepare(fs_stage *s) { return fs_prepare(s); }
void settle(fs_stage *s, const fs_real *commands) { fs_settle(s, commands); }
void jump(fs_stage *s, const fs_real *commands) { fs_jump(s, commands); }
void readings_now(const fs_stage *s, fs_real *readings) { fs_readings(s, readings); }
const char *run(fs_stage *s, int n, const fs_real *commands, fs_real *readings)
{
    int i;
    for (i = 0; i < n; i++) {
        const char *m = fs_step(s, commands + i * FS_DRIVES, readings + i * FS_PROBES);
        if (m)
            return m;
    }
    return 0;
}
"""


def access(model: DynamicModel) -> str:
    """C that gets and sets each variable of a model by its number."""
    get = ["double get(fs_stage *s, int i) { switch (i) {"]
    put = ["void put(fs_stage *s, int i, double x) { switch (i) {"]
    for i, v in enumerate(c_variables(model)):
        if v.causality in ("local", "parameter"):
            get.append(f"case {i}: return {v.expression};")
            put.append(f"case {i}: {v.expression} = (fs_real)x; break;")
    return "\n".join([*get, "} return 0.0; }", *put, "} }"])


class CStage:
    """One instance of the C of a model.

    Parameters
    ----------
    folder : Path
        Where it is compiled.
    model : DynamicModel
        The model.
    flags : Sequence of str
        Flags of the compiler; with ``-DFS_SINGLE`` in single precision.
    """

    def __init__(self, folder: Path, model: DynamicModel, flags: Sequence[str] = EXACT) -> None:
        self.model = model
        self.real = np.float32 if "-DFS_SINGLE" in flags else np.float64
        self.names = [v.name for v in c_variables(model)]
        source = _WRAPPED + access(model)
        self.library = load_library(folder, source, files=render_source(model), flags=flags)
        for name in ("run", "prepare"):
            getattr(self.library, name).restype = ctypes.c_char_p
        self.library.size.restype = ctypes.c_size_t
        self.library.get.restype = ctypes.c_double
        self.library.put.argtypes = [ctypes.c_void_p, ctypes.c_int, ctypes.c_double]
        self.bytes = self.fresh()

    def fresh(self) -> ctypes.Array[ctypes.c_char]:
        """Return the bytes of another instance, as exported."""
        made = ctypes.create_string_buffer(self.library.size())
        self.library.init(made)
        return made

    def _row(self, commands: Sequence[float]) -> ctypes.c_void_p:
        self._kept = np.array(commands, dtype=self.real)
        return self._kept.ctypes.data_as(ctypes.c_void_p)

    def settle(self, *commands: float) -> None:
        self.library.settle(self.bytes, self._row(commands))

    def jump(self, *commands: float) -> None:
        self.library.jump(self.bytes, self._row(commands))

    def readings(self) -> Array:
        out = np.empty(len(self.model.probes), dtype=self.real)
        self.library.readings_now(self.bytes, out.ctypes.data_as(ctypes.c_void_p))
        return out.astype(np.float64)

    def message(self, commands: ArrayLike) -> str | None:
        """Step through commands, one row a sample, and return the message."""
        return self._run(commands)[1]

    def run(self, commands: ArrayLike) -> Array:
        """Step through commands, one row a sample, and return the readings likewise."""
        out, message = self._run(commands)
        assert message is None, message
        return out.astype(np.float64)

    def _run(self, commands: ArrayLike) -> tuple[NDArray[np.floating], str | None]:
        u = np.ascontiguousarray(commands, dtype=self.real)
        out = np.full((u.shape[0], len(self.model.probes)), np.nan, dtype=self.real)
        said = self.library.run(
            self.bytes,
            u.shape[0],
            u.ctypes.data_as(ctypes.c_void_p),
            out.ctypes.data_as(ctypes.c_void_p),
        )
        return out, said.decode() if said else None

    def get(self, name: str) -> float:
        return float(self.library.get(self.bytes, self.names.index(name)))

    def put(self, name: str, value: float) -> None:
        self.library.put(self.bytes, self.names.index(name), value)

    def prepare(self) -> str | None:
        said = self.library.prepare(self.bytes)
        return said.decode() if said else None


def stepped(
    model: DynamicModel, commands: Array, memory: ModelState | None = None
) -> tuple[Array, ModelState]:
    """Readings and memory of Python stepped one sample at a time, from rest at zero commands."""
    model = model.as_exported()
    now = model.settled() if memory is None else memory
    rows = []
    for row in commands.tolist():
        given = {d.name: [u] for d, u in zip(model.drives, row, strict=True)}
        found = model.simulate(given, now)
        now = found.state
        rows.append([float(found.readings[p.name][0]) for p in model.probes])
    return np.array(rows), now


def wandering(count: int, ranges: Sequence[tuple[float, float]], seed: int) -> Array:
    """Commands that wander over ranges with fast and slow, long, tiny and no moves."""
    rng = np.random.default_rng(seed)
    size = rng.choice([0.0, 1e-9, 1e-3, 0.05, 0.6], size=(count, len(ranges)))
    u = np.empty((count, len(ranges)))
    now = np.zeros(len(ranges))
    for k in range(count):
        for i, (low, high) in enumerate(ranges):
            now[i] = np.clip(now[i] + size[k, i] * (high - low) * rng.normal(), low, high)
        if k % 50 == 49:
            # back to where it was, exactly
            now[:] = u[k - 1]
        u[k] = now
    return u
