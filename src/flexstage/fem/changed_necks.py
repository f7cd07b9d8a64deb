"""A condensed body whose necks become thicker or thinner: what that changes is local."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from flexstage.arrays import Array
from flexstage.errors import HingeError, StageError
from flexstage.fem.condensation import Condensed
from flexstage.fem.freedom import freedom
from flexstage.fem.substructure import Substructure
from flexstage.hinges import Profile
from flexstage.hinges.other_notch import with_neck_thickness
from flexstage.stage import Hinge, Loop
from flexstage.stage.hinge_attachment import TOLERANCE, Root, hinge_root, root_line

# Largest ratio of the thicknesses of a neck; a body with another is condensed anew.
_FARTHEST = 1.15
_MEMBERS = 5  # of a family, an odd number: the neck as it was is the one in the middle

# How far the block goes beyond the root of a notch, to either side and inward, in heights of the
# root. What a neck changes does not reach so far, and where a body ends before, so does the block.
_BEYOND = 1.5


@dataclass(frozen=True, slots=True, kw_only=True)
class ChangedNeck:
    """A neck that is thicker or thinner than before."""

    number: int
    """Which of the body's necks."""
    thicker: float
    """Its thickness over what it was."""
    blocks: tuple[Substructure, ...]
    """The part of the body about the root of its notch, held where it was cut, with necks from the
    thinnest to the thickest that is followed; the one in the middle is as it was.
    """


def changed_necks(before: Substructure, after: Substructure) -> list[ChangedNeck]:
    """Return the necks in whose thickness alone two bodies differ; none where there is more.

    Thicknesses that differ by more than is followed are more, too, and so is a neck that does not
    fit: what is wrong with it is said by who condenses the body anew.
    """
    if len(before.necks) != len(after.necks):
        return []
    same = tuple(
        replace(new, profile=old.profile, contour=old.contour)
        for old, new in zip(before.necks, after.necks, strict=True)
    )
    if replace(after, necks=same) != before:
        return []
    try:
        return [
            _changed_neck(before, new.profile, i)
            for i, (old, new) in enumerate(zip(before.necks, after.necks, strict=True))
            if old != new
        ]
    except (HingeError, StageError):
        return []


def _changed_neck(before: Substructure, new: Profile, number: int) -> ChangedNeck:
    old, thick = before.necks[number].profile, new.neck_thickness
    thicker = thick / old.neck_thickness
    if not 1.0 / _FARTHEST < thicker < _FARTHEST:
        raise HingeError(f"a neck {thicker:.3g} times as thick is not followed")
    # the contour moves outward with the neck, or the cut is less deep from a mouth that stays
    made = _outward if _outward(old, thick) == new else with_neck_thickness
    if made(old, thick) != new:
        raise HingeError("another dimension than the thickness of the neck is not followed")
    hinge, root = _root(before, number)
    ends = root_line(replace(hinge, profile=new), before.necks[number].which)
    for end, corner, side in zip(ends, root.edge, (-1.0, 1.0), strict=True):
        (x, y), (edge, most) = hinge.from_plane(end), hinge.from_plane(corner)
        if abs(x - edge) > TOLERANCE or side * (y - most) > TOLERANCE:
            raise StageError("the notch does not end within the edge of its body")
    return ChangedNeck(number=number, thicker=thicker, blocks=_blocks(before, number, made))


def _outward(profile: Profile, thickness: float) -> Profile:
    return replace(profile, neck_thickness=thickness)


@lru_cache(maxsize=1024)
def _root(part: Substructure, number: int) -> tuple[Hinge, Root]:
    """Return a hinge of a body and where it grows from it."""
    stage = part.stage()
    return stage.hinges[number], hinge_root(stage, stage.hinges[number], part.necks[number].which)


@lru_cache(maxsize=1024)
def _blocks(
    part: Substructure, number: int, made: Callable[[Profile, float], Profile]
) -> tuple[Substructure, ...]:
    block = _block(part, number)
    (neck,) = block.necks
    old = neck.profile
    profiles = (made(old, math.exp(x) * old.neck_thickness) if x else old for x in _nodes())
    return tuple(
        replace(block, necks=(replace(neck, profile=p, contour=p.contour()),)) for p in profiles
    )


def _block(part: Substructure, number: int) -> Substructure:
    neck = part.necks[number]
    hinge, root = _root(part, number)
    reach = _BEYOND * neck.profile.root_height
    # as wide as the thickest neck needs, where the root takes all of the edge
    least = (_FARTHEST - 1.0) * neck.profile.neck_thickness
    ends, edge = ([hinge.from_plane(p)[1] for p in pair] for pair in (root.ends, root.edge))
    right, left = (
        end + sign * min(max(sign * (corner - end), least), reach)
        for end, corner, sign in zip(ends, edge, (-1.0, 1.0), strict=True)
    )
    side = (-1, 1)[neck.which]
    near = side * neck.profile.length / 2.0
    far = near + side * reach
    return replace(
        part,
        outline=Loop(((near, right), (far, right), (far, left), (near, left))[::side]),
        holes=(),
        mounting_holes=(),
        held=True,
        necks=(replace(neck, at=(0.0, 0.0), direction=0.0),),
        patches=(),
        readings=(),
        modes=0,
    )


def _nodes() -> Array:
    """Return the logarithms of the thicknesses of a family, Chebyshev's nodes."""
    angles = math.pi * (2.0 * np.arange(_MEMBERS) + 1.0) / (2.0 * _MEMBERS)
    nodes = -math.log(_FARTHEST) * np.cos(angles)
    nodes[_MEMBERS // 2] = 0.0
    return nodes


class NeckFamily:
    r"""Blocks that differ in the thickness of their neck, condensed: those of a `ChangedNeck`.

    Flexibility and mass are interpolated as polynomials of the logarithm of thickness. The largest
    stress for each force on the neck is taken as a power of thickness, whose exponent is linear in
    that logarithm: so it is free of how the meshes of the members lie.

    Notes
    -----
    Validity: of a flexibility that goes with :math:`t^{-5/2}` the interpolation is within 3e-6,
    below what the meshes of the members differ by (2e-4).
    """

    def __init__(self, members: Sequence[Condensed]) -> None:
        nodes = _nodes()
        self.weights = np.linalg.inv(np.vander(nodes, increasing=True))
        found, largest = [], []
        for block in members:
            each = block.interfaces
            flexibility = np.linalg.inv(block.stiffness[:each, :each])
            found.append(0.5 * (flexibility + flexibility.T))
            largest.append(np.log(np.abs(block.stress).max(axis=(0, 1))))
        self.flexibility = np.array(found)
        self.mass = np.array([block.inertia[0] for block in members])
        self.as_it_was = self.flexibility[_MEMBERS // 2], float(self.mass[_MEMBERS // 2])
        self.powers = np.polynomial.polynomial.polyfit(nodes, np.array(largest), 2)[1:]

    def at(self, thicker: float) -> tuple[Array, Array, float]:
        """Return what a neck adds that is so many times as thick as that in the middle.

        The flexibility of the motions of the neck, shape (e, e), how many times larger the stress
        is for each force on it, shape (e,), and the mass of the block [kg].
        """
        x = math.log(thicker)
        share = x ** np.arange(_MEMBERS) @ self.weights
        scale = np.exp(np.array([x, x * x]) @ self.powers)
        flexibility = share @ self.flexibility.reshape(_MEMBERS, -1)
        return flexibility.reshape(self.flexibility.shape[1:]), scale, float(share @ self.mass)


def with_other_necks(
    condensed: Condensed, part: Substructure, necks: Sequence[tuple[ChangedNeck, NeckFamily]]
) -> Condensed:
    r"""Return a condensed body with thicker or thinner necks.

    The halves of its notches are more flexible by :math:`\Delta F`, the difference between the
    blocks about them, which sits between the body and the motions q of its necks. With the
    stiffness K of the interfaces and the forces :math:`\Lambda` on them, held, of the other
    coordinates,

    .. math:: Y = (1 + \Delta F K)^{-1}\Delta F,\quad
              u = T(1 - Y K) q + (\Phi - T Y\Lambda)\eta,\quad
              K' = K - K Y K,\quad K'_\eta = K_\eta + \Lambda^T Y\Lambda

    Parameters
    ----------
    condensed : Condensed
        The body as it was.
    part : Substructure
        The body as it was.
    necks : sequence
        The necks that change, each with its family.

    Returns
    -------
    Condensed
        The body with these necks.

    Notes
    -----
    Validity: what the change of a neck does is local (Saint-Venant), so that it is the same in the
    block as in the body. With all necks of the study's piezo stage thinner by 10 %, the two lowest
    frequencies are within 0.005 % of those of bodies that are condensed anew, the next four within
    0.05 %; changes are nearer to those of fine meshes, as no mesh changes. What a notch weighs more
    or less rides on the mean motion of its body: leaves thinner by 10 % between light levers
    (`lever-chain`) leave 0.06 % in frequency, and 0.002 % in stiffness on fine meshes.
    """
    m, r = condensed.interfaces, len(condensed.stiffness)
    way = freedom(part.through)
    each = len(way.necks)
    size = np.ones(r)  # of the coordinates, in those that they were before
    more, gains, scales = np.zeros((m, m)), [], []
    for neck, blocks in necks:
        own = np.arange(each * neck.number, each * (neck.number + 1))
        size[own[way.turning]] = neck.thicker
        (before, light), (after, scale, heavy) = blocks.as_it_was, blocks.at(neck.thicker)
        more[np.ix_(own, own)] = after - before * np.outer(size[own], size[own])
        gains.append(heavy - light)
        scales.append(scale)
    K = (condensed.stiffness / np.outer(size, size))[:m, :m]
    held = condensed.reactions / size[:m, None]
    Y = np.linalg.solve(np.eye(m) + more @ K, more)
    Y = 0.5 * (Y + Y.T)
    basis = np.eye(r)
    basis[:m, :m] -= Y @ K
    basis[:m, m:] -= Y @ held
    basis /= size[:, None]
    stiffness = condensed.stiffness.copy()
    stiffness[:m, :m] = K - K @ Y @ K
    stiffness[m:, m:] += held.T @ Y @ held
    loads = condensed.loads @ basis
    mass = basis.T @ condensed.mass @ basis
    whole, x, y, turning = condensed.inertia
    for (neck, _), gain in zip(necks, gains, strict=True):
        # what a notch gains rides on the mean motion of the body
        riding = way.read((x, y), part.necks[neck.number].at) @ loads[:3]
        mass += gain * riding.T @ riding
    stress = condensed.stress.copy()
    for (neck, _), scale in zip(necks, scales, strict=True):
        stress[condensed.neck == neck.number] *= scale
    return replace(
        condensed,
        stiffness=0.5 * (stiffness + stiffness.T),
        mass=0.5 * (mass + mass.T),
        loads=loads,
        reactions=held - K @ Y @ held,
        stress=stress,
        inertia=(whole + sum(gains), x, y, turning),
    )
