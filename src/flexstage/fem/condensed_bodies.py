"""All bodies of a stage condensed, each once, or found in the cache."""

import os
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import fields
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from flexstage import progress
from flexstage.cache.cache import Cache, open_cache
from flexstage.fem.condensation import Condensed, condense
from flexstage.fem.plate_condensation import condense_plate
from flexstage.fem.substructure import Substructure

# bodies in space whose factors are in memory at once, some hundred megabytes each
_THREADS = 4


def condense_all(
    parts: Sequence[Substructure], cache: Cache | Path | str | bool | None
) -> tuple[list[Condensed], list[int]]:
    """Condense bodies, each only once, or find them in the cache; say which were new."""
    store = open_cache(cache)
    ready: dict[str, Condensed] = {}
    missing: dict[str, Substructure] = {}
    keys = [part.key() for part in parts]
    for key, part in zip(keys, parts, strict=True):
        if key in ready or key in missing:
            continue
        entry = None if store is None else store.load(key)
        if entry is None:
            missing[key] = part
        else:
            ready[key] = _from_arrays(entry)
    in_space = any(p.through is not None for p in missing.values())
    with ThreadPoolExecutor(_threads() if in_space else 1) as workers:
        made = workers.map(_condense, missing.values())
        for i, (key, found) in enumerate(zip(missing, made, strict=True)):
            progress.update("bodies", i / len(missing))
            ready[key] = found
            if store is not None:
                store.store(key, _to_arrays(found))
    if store is not None:
        store.trim()
    return [ready[key] for key in keys], [keys.index(key) for key in missing]


def _threads() -> int:
    """Return how many bodies are condensed side by side, by threads that share the mesher.

    Where the linear algebra has threads of its own there is one: several that each start others
    take five times as long. The commands give it one (`flexstage.cli`).
    """
    single = any(os.environ.get(f"{name}_NUM_THREADS") == "1" for name in ("OPENBLAS", "OMP"))
    return min(os.cpu_count() or 1, _THREADS) if single else 1


def _condense(part: Substructure) -> Condensed:
    return condense(part) if part.through is None else condense_plate(part)


def _to_arrays(condensed: Condensed) -> dict[str, NDArray]:
    arrays = {}
    for f in fields(Condensed):
        value = getattr(condensed, f.name)
        if isinstance(value, str):
            value = np.frombuffer(value.encode(), dtype=np.uint8)
        arrays[f.name] = np.asarray(value)
    return arrays


def _from_arrays(arrays: Mapping[str, NDArray]) -> Condensed:
    plain = {
        "interfaces": int(arrays["interfaces"]),
        "elements": int(arrays["elements"]),
        "unknowns": int(arrays["unknowns"]),
        "inertia": tuple(arrays["inertia"].tolist()),
        "held": arrays["held"].tobytes().decode(),
    }
    rest = {f.name: arrays[f.name] for f in fields(Condensed) if f.name not in plain}
    return Condensed(**rest, **plain)
