"""Condensation of all bodies of a stage, each once, or from the cache.

A body of which only the necks become thicker or thinner follows from the known one: the change is
local.
"""

import math
import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from flexstage.base import progress
from flexstage.base.arrays import Array
from flexstage.base.errors import HingeError, StageError
from flexstage.fem.condensation import Condensed, condense, notch_block_of
from flexstage.fem.layered_plate import REFERENCE
from flexstage.fem.necks import interface_dofs
from flexstage.fem.notch_block import NotchBlock, neck_response, notch_of
from flexstage.fem.substructure import Substructure
from flexstage.files.cache.cache import Cache, open_cache
from flexstage.files.cache.memory import pack, unpack
from flexstage.hinges import Profile
from flexstage.hinges.registry import with_neck_thickness
from flexstage.stage import Hinge
from flexstage.stage.contour import TOLERANCE, Root, half_notch, hinge_root, root_line

# Largest ratio of the thicknesses of a neck; a body with another is condensed anew.
_FARTHEST = 1.15
_MEMBERS = 3  # of a family: the neck as it was is the one in the middle


@dataclass(frozen=True, slots=True, kw_only=True)
class ChangedNeck:
    """A neck that is thicker or thinner than before."""

    number: int
    """Number of the neck of the body."""
    thicker: float
    """Thickness over the former one."""
    gain: float
    """Mass that half of the notch gains [kg], of the `REFERENCE` material."""
    halves: tuple[NotchBlock, ...]
    """Half of the notch with a block of the body, with necks from the thinnest to the thickest of
    the family; the one in the middle is unchanged.
    """


def changed_necks(before: Substructure, after: Substructure) -> list[ChangedNeck]:
    """Return the necks if two bodies differ in their thickness alone; else none.

    There are none either if a thickness is outside the family, or if a neck does not fit: the
    condensation of the body then reports the error.
    """
    if len(before.necks) != len(after.necks):
        return []
    if before.rigid or before.body_material is not None:
        return []  # the block of the body about a neck would be of another material
    same = tuple(
        replace(new, profile=old.profile, contour=old.contour)
        for old, new in zip(before.necks, after.necks, strict=True)
    )
    if replace(after, necks=same) != before:
        return []
    try:
        changes = [
            _changed_neck(before, new.profile, i)
            for i, (old, new) in enumerate(zip(before.necks, after.necks, strict=True))
            if old != new
        ]
    except (HingeError, StageError):
        return []
    return [neck for neck in changes if neck is not None] if None not in changes else []


def _changed_neck(before: Substructure, new: Profile, number: int) -> ChangedNeck | None:
    """Return the change of a neck; None where the family has no such notch."""
    old, thick = before.necks[number].profile, new.neck_thickness
    thicker = thick / old.neck_thickness
    if not 1.0 / _FARTHEST < thicker < _FARTHEST:
        return None
    # the contour moves outward with the neck, or the cut is less deep from a mouth that stays
    change_of_profile = _outward if _outward(old, thick) == new else with_neck_thickness
    if change_of_profile(old, thick) != new:
        return None
    hinge, root = _root(before, number)
    ends = root_line(replace(hinge, profile=new), before.necks[number].which)
    for end, corner, side in zip(ends, root.edge, (-1.0, 1.0), strict=True):
        (x, y), (edge, most) = hinge.from_plane(end), hinge.from_plane(corner)
        if abs(x - edge) > TOLERANCE or side * (y - most) > TOLERANCE:
            return None  # it does not end within the edge of its body
    return ChangedNeck(
        number=number,
        thicker=thicker,
        gain=REFERENCE.density * before.through.thickness * (_area(new) - _area(old)),
        halves=_halves(before, number, change_of_profile),
    )


def _outward(profile: Profile, thickness: float) -> Profile:
    return replace(profile, neck_thickness=thickness)


@lru_cache(maxsize=1024)
def _root(part: Substructure, number: int) -> tuple[Hinge, Root]:
    """Return a hinge of a body and its root on it."""
    stage = part.stage()
    return stage.hinges[number], hinge_root(stage, stage.hinges[number], part.necks[number].which)


@lru_cache(maxsize=1024)
def _halves(
    part: Substructure, number: int, change_of_profile: Callable[[Profile, float], Profile]
) -> tuple[NotchBlock, ...]:
    # a wide block for narrow bodies too: its far end is farther from the notch than theirs
    half = notch_block_of(part, number, _root(part, number)[1])
    half = replace(half, wide=True, powers=part.mesh.order)
    old = half.profile
    profiles = [
        change_of_profile(old, math.exp(x) * old.neck_thickness) if x else old for x in _nodes()
    ]
    # one block for all of them, as wide as the thickest needs
    grows = profiles[-1].root_height - old.root_height > TOLERANCE
    widest = profiles[-1] if grows else None
    return tuple(replace(half, profile=p, widest=widest) for p in profiles)


@lru_cache(maxsize=1024)
def _area(profile: Profile) -> float:
    """Return the area of half of a notch [m^2]."""
    return abs(half_notch(notch_of(profile), 0).integrals().area)


def _nodes() -> Array:
    """Return the logarithms of the thicknesses of a family, Chebyshev's nodes."""
    angles = math.pi * (2.0 * np.arange(_MEMBERS) + 1.0) / (2.0 * _MEMBERS)
    nodes = -math.log(_FARTHEST) * np.cos(angles)
    nodes[_MEMBERS // 2] = 0.0
    return nodes


class NeckFamily:
    r"""Half notches that differ in the thickness of their necks: those of a `ChangedNeck`.

    Of a flexibility F with the square roots :math:`s_i = \sqrt{F_{ii}}` polynomials of the
    logarithm of thickness go through :math:`\log s_i` and :math:`F_{ij}/s_i s_j`; the largest
    stress for each force on the neck is a power of thickness, whose exponent is linear in
    that logarithm.

    Notes
    -----
    Validity: between its members a flexibility is within 2e-5, which is the scatter between meshes.
    """

    def __init__(self, members: Sequence[tuple[Array, Array]], lengthwise: NDArray[np.bool_]):
        nodes = _nodes()
        self.lengthwise = lengthwise
        self.weights = np.linalg.inv(np.vander(nodes, increasing=True))
        flexibility = np.array([0.5 * (f + f.T) for f, _ in members])
        size = np.sqrt(np.diagonal(flexibility, axis1=1, axis2=2))
        self.size = np.log(size)
        self.likeness = flexibility / (size[:, :, None] * size[:, None, :])
        self.stress = np.log([largest for _, largest in members])
        self.as_it_was = flexibility[_MEMBERS // 2]

    def at(self, thicker: float) -> tuple[Array, Array]:
        """Return flexibility and stress of a neck, by its thickness over that in the middle.

        The flexibility of the motions of the neck, shape (e, e), and the factor on the stress for
        each force on it, shape (e,).
        """
        share = math.log(thicker) ** np.arange(_MEMBERS) @ self.weights
        size = np.exp(share @ self.size)
        likeness = np.tensordot(share, self.likeness, axes=1)
        scale = np.exp(share @ self.stress - self.stress[_MEMBERS // 2])
        return likeness * np.outer(size, size), scale

    def of_side(self, which: int, flexibility: Array) -> Array:
        """Return the flexibility of the half on either side, 0 or 1: they mirror one another."""
        sign = np.where(self.lengthwise, -1.0, 1.0) if which else np.ones(len(self.lengthwise))
        return flexibility * np.outer(sign, sign)


def neck_family(halves: Sequence[NotchBlock]) -> NeckFamily:
    """Return the family of half notches."""
    like = halves[_MEMBERS // 2].profile
    responses = [neck_response(half, like) for half in halves]
    members = [(f, np.abs(stress.stress).max(axis=(0, 1, 2))) for f, stress in responses]
    return NeckFamily(members, responses[0][1].lengthwise)


def with_other_necks(
    condensed: Condensed, part: Substructure, necks: Sequence[tuple[ChangedNeck, NeckFamily]]
) -> Condensed:
    r"""Return a condensed body with thicker or thinner necks.

    The halves of its notches are more flexible by :math:`\Delta F`, the difference between half
    notches with a block of the body, which sits between the body and the motions q of its necks.
    With the stiffness K of the interfaces and the forces :math:`\Lambda` on them, held, of the
    other coordinates,

    .. math:: Y = (1 + \Delta F K)^{-1}\Delta F,\quad
              u = T(1 - Y K) q + (\Phi - T Y\Lambda)\eta,\quad
              K' = K - K Y K,\quad K'_\eta = K_\eta + \Lambda^T Y\Lambda

    Parameters
    ----------
    condensed : Condensed
        The body before the change.
    part : Substructure
        The body before the change.
    necks : sequence
        The necks that change, each with its family.

    Returns
    -------
    Condensed
        The body with these necks.

    Notes
    -----
    Validity: the effect of a change of a neck is local (Saint-Venant), so that it is the same in
    the block as in the body. With all necks of the stages of the study thinner by 5 %, on fine
    meshes the two lowest frequencies and the stiffness are within 0.001 % of those of bodies
    condensed anew, the next two frequencies within 0.006 %, stress 0.2 %. The change of mass of a
    notch follows the mean motion of its body, and the modes of the body between fixed necks stay:
    of leaves between light levers, thinner by 5 % (`lever-chain`), the first mode is 0.03 % off,
    those in which leaves swing between their ends are 2 to 7 % high.
    """
    m, r = condensed.interfaces, len(condensed.stiffness)
    way = interface_dofs(part.through)
    each = len(way.necks)
    size = np.ones(r)  # of the coordinates, in those that they were before
    changes, scales = [], []
    for neck, family in necks:
        of_necks = np.arange(each * neck.number, each * (neck.number + 1))
        size[of_necks[way.turning]] = neck.thicker
        after, scale = family.at(neck.thicker)
        change = after - family.as_it_was * np.outer(size[of_necks], size[of_necks])
        changes.append(family.of_side(part.necks[neck.number].which, change))
        scales.append(scale)
    K = (condensed.stiffness / np.outer(size, size))[:m, :m]
    reactions = condensed.reactions / size[:m, None]
    # of the necks that change alone
    of_necks = np.concatenate([each * neck.number + np.arange(each) for neck, _ in necks])
    more = np.asarray(block_diag(*changes))
    Y = np.linalg.solve(np.eye(of_necks.size) + more @ K[np.ix_(of_necks, of_necks)], more)
    Y = 0.5 * (Y + Y.T)
    moved = Y @ np.hstack((K[of_necks], reactions[of_necks]))
    basis = np.eye(r)
    basis[of_necks] -= moved
    basis /= size[:, None]
    stiffness = condensed.stiffness.copy()
    stiffness[:m, :m] = K - K[of_necks].T @ moved[:, :m]
    stiffness[m:, m:] += reactions[of_necks].T @ moved[:, m:]
    loads = condensed.loads @ basis
    mass = basis.T @ condensed.mass @ basis
    total_mass, x, y, turning = condensed.inertia
    for neck, _ in necks:
        # the added mass of a notch follows the mean motion of the body
        riding = way.read((x, y), part.necks[neck.number].at) @ loads[:3]
        mass += neck.gain * riding.T @ riding
    stress = condensed.stress.copy()
    for (neck, _), scale in zip(necks, scales, strict=True):
        stress[condensed.neck == neck.number] *= scale
    return replace(
        condensed,
        stiffness=0.5 * (stiffness + stiffness.T),
        mass=0.5 * (mass + mass.T),
        loads=loads,
        reactions=reactions - K[of_necks].T @ moved[:, m:],
        stress=stress,
        inertia=(total_mass + sum(n.gain for n, _ in necks), x, y, turning),
    )


# bodies in space whose factors are in memory at once, some hundred megabytes each
_THREADS = 4


def condense_all(
    parts: Sequence[Substructure],
    cache: Cache | Path | str | bool | None,
    near: Sequence[tuple[Substructure, Condensed]] = (),
    *,
    moved: bool = False,
) -> tuple[list[Condensed], list[int]]:
    """Condense bodies, each only once, or find them in the cache; also return which were new.

    `near` are known bodies, one for each, or none: an equal body is reused, and one of which only
    necks differ follows from it. If `moved`, the meshes of these are moved to the others, which are
    not cached.
    """
    ready: dict[Substructure, Condensed] = dict(near)
    changes: dict[Substructure, tuple[Substructure, list[ChangedNeck]]] = {}
    for part, (before, _) in zip(parts, near, strict=False):
        if part not in ready and (necks := changed_necks(before, part)):
            changes[part] = before, necks
    like = {part: old for part, (old, _) in zip(parts, near, strict=False)}

    def condensed_anew(others: Sequence[Substructure]) -> list[Substructure]:
        if moved and near:
            return _condense_moved([part for part in others if part not in ready], like, ready)
        return _condense_missing(others, ready, cache)

    with progress.subtask(0.0, 0.5 if changes else 1.0):
        new = condensed_anew([part for part in parts if part not in changes])
    halves = dict.fromkeys(n.halves for _, necks in changes.values() for n in necks)
    families = {}
    with (
        progress.subtask(0.5 if changes else 1.0, 1.0),
        ThreadPoolExecutor(_threads()) as workers,
    ):
        for i, (family_halves, family) in enumerate(
            zip(halves, workers.map(_family, halves), strict=True)
        ):
            progress.update("necks", i / len(halves))
            families[family_halves] = family
    for part, (before, necks) in changes.items():
        with_families = [(neck, families[neck.halves]) for neck in necks]
        other = with_other_necks(ready[before], before, with_families)
        if _keeps_modes(ready[before], other):
            ready[part] = other
    condensed_anew(list(changes))
    new = [*new, *changes]
    return [ready[part] for part in parts], [parts.index(part) for part in new]


def _keeps_modes(before: Condensed, after: Condensed) -> bool:
    """Return whether a change of necks left the modes of a body about as stiff as they were.

    Modes of leaves themselves between light bodies do not: no thickness of a family halves a
    square of a frequency, but the series of `with_other_necks` may even turn it negative.
    """
    lowest = [
        np.linalg.eigvalsh(body.stiffness[body.modes, body.modes]).min(initial=math.inf)
        for body in (before, after)
    ]
    return bool(lowest[1] >= 0.5 * lowest[0])


_family = lru_cache(maxsize=512)(neck_family)


def _condense_missing(
    parts: Sequence[Substructure],
    ready: dict[Substructure, Condensed],
    cache: Cache | Path | str | bool | None,
) -> list[Substructure]:
    """Add missing bodies, from the cache or condensed; return the latter."""
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
        results = workers.map(condense, largest_first)
        for i, (part, condensed) in enumerate(zip(largest_first, results, strict=True)):
            progress.update("bodies", i / len(missing))
            ready[part] = condensed
            if store is not None:
                store.store(missing[part], pack(condensed)[0])
    if store is not None and missing:
        store.trim()
    return list(missing)


def _condense_moved(
    parts: Sequence[Substructure],
    like: dict[Substructure, Substructure],
    ready: dict[Substructure, Condensed],
) -> list[Substructure]:
    """Add bodies on the moved meshes of others; return them."""
    new = list(dict.fromkeys(parts))
    with ThreadPoolExecutor(_threads()) as workers:
        ready |= zip(new, workers.map(condense, new, [like[part] for part in new]), strict=True)
    return new


def _threads() -> int:
    """Return the number of bodies condensed in parallel, by threads that share the mesher.

    Where the linear algebra has threads of its own there is one: nested threads take five times as
    long. The commands limit linear algebra to one thread (`flexstage.cli`).
    """
    single = any(os.environ.get(f"{name}_NUM_THREADS") == "1" for name in ("OPENBLAS", "OMP"))
    return min(os.cpu_count() or 1, _THREADS) if single else 1
