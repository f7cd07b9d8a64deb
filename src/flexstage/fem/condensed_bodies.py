"""All bodies of a stage condensed, each once, or found in the cache."""

import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache
from pathlib import Path

from flexstage import progress
from flexstage.cache.cache import Cache, open_cache
from flexstage.cache.memory import pack, unpack
from flexstage.fem.changed_necks import (
    ChangedNeck,
    changed_necks,
    neck_family,
    with_other_necks,
)
from flexstage.fem.condensation import Condensed, condense
from flexstage.fem.substructure import Substructure

# bodies in space whose factors are in memory at once, some hundred megabytes each
_THREADS = 4


def condense_all(
    parts: Sequence[Substructure],
    cache: Cache | Path | str | bool | None,
    near: Sequence[tuple[Substructure, Condensed]] = (),
) -> tuple[list[Condensed], list[int]]:
    """Condense bodies, each only once, or find them in the cache; say which were new.

    `near` are bodies that are known, one for each if they are any: what is the same is taken from
    there, and one of which necks alone differ follows from it.
    """
    ready: dict[Substructure, Condensed] = dict(near)
    changes: dict[Substructure, tuple[Substructure, list[ChangedNeck]]] = {}
    for part, (before, _) in zip(parts, near, strict=False):
        if part not in ready and (necks := changed_necks(before, part)):
            changes[part] = before, necks
    with progress.subtask(0.0, 0.5 if changes else 1.0):
        new = _condense_missing([part for part in parts if part not in changes], ready, cache)
    halves = dict.fromkeys(n.halves for _, necks in changes.values() for n in necks)
    families = {}
    with (
        progress.subtask(0.5 if changes else 1.0, 1.0),
        ThreadPoolExecutor(_threads()) as workers,
    ):
        for i, (own, family) in enumerate(zip(halves, workers.map(_family, halves), strict=True)):
            progress.update("necks", i / len(halves))
            families[own] = family
    for part, (before, necks) in changes.items():
        known = [(neck, families[neck.halves]) for neck in necks]
        ready[part] = with_other_necks(ready[before], before, known)
    new = [*new, *changes]
    return [ready[part] for part in parts], [parts.index(part) for part in new]


_family = lru_cache(maxsize=512)(neck_family)


def _condense_missing(
    parts: Sequence[Substructure],
    ready: dict[Substructure, Condensed],
    cache: Cache | Path | str | bool | None,
) -> list[Substructure]:
    """Add those that are not ready yet, from the cache or condensed; return the latter."""
    store = open_cache(cache)
    missing: dict[Substructure, str] = {}
    for part in dict.fromkeys(parts):
        if part in ready:
            continue
        key = part.key()
        entry = None if store is None else store.load(key)
        if entry is None:
            missing[part] = key
        else:
            ready[part] = unpack(entry)
    # the largest first, so that no thread waits long for another at the end
    largest_first = sorted(missing, key=lambda part: -len(part.necks))
    with ThreadPoolExecutor(_threads()) as workers:
        made = workers.map(condense, largest_first)
        for i, (part, found) in enumerate(zip(largest_first, made, strict=True)):
            progress.update("bodies", i / len(missing))
            ready[part] = found
            if store is not None:
                store.store(missing[part], pack(found)[0])
    if store is not None and missing:
        store.trim()
    return list(missing)


def _threads() -> int:
    """Return how many bodies are condensed side by side, by threads that share the mesher.

    Where the linear algebra has threads of its own there is one: several that each start others
    take five times as long. The commands give it one (`flexstage.cli`).
    """
    single = any(os.environ.get(f"{name}_NUM_THREADS") == "1" for name in ("OPENBLAS", "OMP"))
    return min(os.cpu_count() or 1, _THREADS) if single else 1
