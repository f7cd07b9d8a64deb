"""Bodies and hinges of a stage that do the same, so that one can be drawn for all of them."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from flexstage.lumped import Mechanism
from flexstage.lumped.rigid_bodies import SpringHinge

T = TypeVar("T")


@dataclass(frozen=True, slots=True, kw_only=True)
class EquivalentParts:
    """Classes of bodies and of hinges."""

    bodies: tuple[tuple[int, ...], ...]
    """Indices of the free bodies of each class."""
    hinges: tuple[tuple[int, ...], ...]
    """Indices of the hinges of each class."""


def equivalent_parts(mechanism: Mechanism, *, tolerance: float | None = 0.02) -> EquivalentParts:
    """Find bodies and hinges that stand in the same place of the chain, as mirror images do.

    Two bodies are twins if they have the same mass and inertia and the same hinges, at the same
    distance from their centres, to bodies that are twins in turn; masses, stiffnesses and distances
    may differ by the tolerance [1], and with None nothing has a twin. Held bodies and those where
    a drive acts or a probe reads have no twins. It is the refinement of colours of a graph (B.
    Weisfeiler, A. Lehman, 1968).

    Examples
    --------
    >>> from flexstage.designs import design
    >>> from flexstage.lumped import mechanism
    >>> found = equivalent_parts(mechanism(design("vgtu-piezo")))
    >>> len(found.bodies), len(found.hinges)
    (10, 12)
    """
    if tolerance is None:
        return EquivalentParts(
            bodies=tuple((i,) for i in mechanism.free),
            hinges=tuple((i,) for i in range(len(mechanism.hinges))),
        )
    alone = _alone(mechanism)
    sorts = _sorted_alike(mechanism.hinges, lambda a, b: _alike(a, b, tolerance))
    colour: list[object] = list(
        _sorted_alike(
            range(len(mechanism.bodies)),
            lambda i, j: (
                i not in alone
                and j not in alone
                and _near(mechanism.bodies[i].mass, mechanism.bodies[j].mass, tolerance)
                and _near(mechanism.bodies[i].inertia, mechanism.bodies[j].inertia, tolerance)
            ),
        )
    )
    ends = _ends(mechanism, tolerance)
    for _ in mechanism.bodies:
        seen: list[list[tuple[object, ...]]] = [[] for _ in mechanism.bodies]
        for k, hinge in enumerate(mechanism.hinges):
            a, b = hinge.bodies
            seen[a].append((sorts[k], ends[k][0], colour[b]))
            seen[b].append((sorts[k], ends[k][1], colour[a]))
        richer = [(c, tuple(sorted(s, key=repr))) for c, s in zip(colour, seen, strict=True)]
        finer = _sorted_alike(richer, lambda a, b: a == b)
        if len(set(finer)) == len(set(colour)):
            break
        colour = list(finer)
    kinds = [
        (sorts[k], *sorted((repr((colour[h.bodies[0]], ends[k][0])),
                            repr((colour[h.bodies[1]], ends[k][1])))))
        for k, h in enumerate(mechanism.hinges)
    ]  # fmt: skip
    return EquivalentParts(
        bodies=_classes(mechanism.free, [colour[i] for i in mechanism.free]),
        hinges=_classes(range(len(mechanism.hinges)), kinds),
    )


def _alone(mechanism: Mechanism) -> set[int]:
    """Bodies that are like no other."""
    held = {i for i, body in enumerate(mechanism.bodies) if body.fixed}
    for sight in (*mechanism.drives, *mechanism.probes):
        held |= {i for i in sight.bodies if i >= 0}
    return held


def _near(a: float, b: float, tolerance: float) -> bool:
    return abs(a - b) <= tolerance * max(abs(a), abs(b))


def _alike(a: SpringHinge, b: SpringHinge, tolerance: float) -> bool:
    """Whether two hinges have one stiffness, but for the side that they are seen from."""
    scale = np.sqrt(np.outer(np.diag(a.stiffness), np.diag(a.stiffness)))
    return bool(
        np.all(np.abs(np.abs(a.stiffness) - np.abs(b.stiffness)) <= tolerance * np.abs(scale))
    )


def _ends(mechanism: Mechanism, tolerance: float) -> list[tuple[int, int]]:
    """Sort of the distance from each end's centre of mass to the neck."""
    distances = [
        float(np.hypot(h.at[0] - c[0], h.at[1] - c[1]))
        for h in mechanism.hinges
        for c in (mechanism.bodies[i].centre for i in h.bodies)
    ]
    fixed = {i for i, body in enumerate(mechanism.bodies) if body.fixed}
    owners = [i for h in mechanism.hinges for i in h.bodies]
    alone = _alone(mechanism) | fixed
    # where a hinge stands on a body that is like no other does not tell it from its image: both
    # images stand there, at distances that differ where that body is not symmetric itself
    marked = [-1.0 if owner in alone else d for owner, d in zip(owners, distances, strict=True)]
    sort = _sorted_alike(marked, lambda a, b: _near(a, b, tolerance))
    return list(zip(sort[::2], sort[1::2], strict=True))


def _sorted_alike(things: Sequence[T], alike: Callable[[T, T], bool]) -> list[int]:
    """Number the sorts of things; each belongs to the first sort whose first it is like."""
    firsts: list[T] = []
    out = []
    for thing in things:
        for k, first in enumerate(firsts):
            if alike(first, thing):
                out.append(k)
                break
        else:
            out.append(len(firsts))
            firsts.append(thing)
    return out


def _classes(members: Sequence[int], kinds: Sequence[object]) -> tuple[tuple[int, ...], ...]:
    found: dict[object, list[int]] = {}
    for member, kind in zip(members, kinds, strict=True):
        found.setdefault(kind, []).append(member)
    return tuple(tuple(group) for group in found.values())
