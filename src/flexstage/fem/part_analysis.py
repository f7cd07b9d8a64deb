"""What finite elements say of a part that was drawn elsewhere: mass, modes, stiffness."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexstage.elasticity import Continuum
from flexstage.elasticity.memory import require_memory
from flexstage.errors import StageError
from flexstage.fem.interface import interface_stiffness
from flexstage.fem.part import Part
from flexstage.fem.part_mesh import PartMesh
from flexstage.material import Material
from flexstage.progress import share, tell

__all__ = ["PartAnalysis", "analyse_part", "named_faces"]

Array = NDArray[np.float64]
_RIGID_HZ = 1.0  # what a free part's six rigid motions come out at is rounding below this


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PartAnalysis:
    """A part, held or free.

    Parameters
    ----------
    part : Part
        The part.
    material : Material
        What it is made of.
    order : int
        Polynomial order of the displacement.
    unknowns : int
        Unknowns of the mesh.
    held : tuple of str
        Faces that are held; empty for a free part.
    frequency_hz : numpy.ndarray
        Natural frequencies, rigid motions left out [Hz], shape (k,).
    moved : tuple of str
        Faces whose stiffness was asked for.
    at : tuple of float
        Their common centroid, about which the stiffness is [m].
    stiffness : numpy.ndarray or None
        Forces [N] and moments [N m] over displacements [m] and rotations [rad] of the moved faces,
        held and moved faces rigid, shape (6, 6).
    """

    part: Part
    material: Material
    order: int
    unknowns: int
    held: tuple[str, ...]
    frequency_hz: Array
    moved: tuple[str, ...]
    at: tuple[float, ...]
    stiffness: Array | None


def named_faces(part: Part, text: str) -> tuple[str, ...]:
    """Return the faces that a text names.

    Parameters
    ----------
    part : Part
        The part.
    text : str
        Names with commas between; ``x-min``, ``z-max`` and so on stand for the plane faces at that
        end of the part.

    Returns
    -------
    tuple of str
        Their names.

    Raises
    ------
    StageError
        There is no such face.

    Examples
    --------
    >>> from netgen.occ import Box
    >>> part = Part.from_shape(Box((0, 0, 0), (7.0, 2.0, 1.0)))
    >>> named_faces(part, "x-min") == part.select("x", "min")
    True
    """
    found: list[str] = []
    for word in (w.strip() for w in text.split(",")):
        axis, _, end = word.partition("-")
        if axis in ("x", "y", "z") and end in ("min", "max"):
            found += part.select(axis, end)
        else:
            part.boundary(word)
            found.append(word)
    return tuple(dict.fromkeys(found))


def analyse_part(
    part: Part,
    material: Material,
    *,
    hold: Sequence[str] = (),
    move: Sequence[str] = (),
    mesh: PartMesh | None = None,
    modes: int = 6,
) -> PartAnalysis:
    """Analyse a part.

    Parameters
    ----------
    part : Part
        The part.
    material : Material
        What it is made of.
    hold : sequence of str
        Names of the faces that are held; none for a part that floats.
    move : sequence of str
        Names of the faces whose stiffness is wanted, as if a rigid plate were fixed to them.
    mesh : PartMesh, optional
        How fine; the displacement has the order of the mesh.
    modes : int
        Number of natural frequencies.

    Returns
    -------
    PartAnalysis
        The result.

    Raises
    ------
    StageError
        A face does not exist, is held and moved, or is moved while none is held.
    ModelError
        The mesher failed, or the memory does not suffice.

    Notes
    -----
    Validity: small displacements, one isotropic material; parts in contact count as joined.
    """
    both = set(hold) & set(move)
    if both:
        raise StageError(f"face '{min(both)}' cannot be held and moved: name it once")
    if move and not hold:
        raise StageError("the stiffness of a face is against held ones: name some to hold")
    chosen = mesh if mesh is not None else PartMesh()
    held, moved = (part.boundary(tuple(f)) if f else "" for f in (hold, move))
    tell("mesh")
    made = part.mesh(chosen)
    low, high = part.bounding_box
    # a free part is shifted by a frequency that its elastic modes lie far above
    shift = 0.0 if hold else (2.0 * np.pi * 10.0) ** 2
    continuum = Continuum(made, material, order=chosen.order, held=held, shift=shift)
    sides = [h - b for b, h in zip(low, high, strict=True)]
    require_memory(continuum.size, 3, chosen.order, box=sides)
    with share(0.1, 0.6 if move else 1.0):
        omega, _ = continuum.modes(modes + (0 if hold else 6))
    continuum.release()
    frequency = omega / (2.0 * np.pi)
    if not hold:
        frequency = frequency[frequency > _RIGID_HZ][:modes]
    faces = [f for f in part.faces if f.name in set(move)]
    area = sum(f.area for f in faces)
    at = tuple(sum(f.area * f.centre[i] for f in faces) / area for i in range(3)) if faces else ()
    stiffness = None
    if move:
        with share(0.6, 1.0):
            tell("stiffness")
            rig = Continuum(made, material, order=chosen.order, held=f"{held}|{moved}")
            stiffness = interface_stiffness(rig, moved, held, at=at, rigid=True)
    return PartAnalysis(
        part=part,
        material=material,
        order=chosen.order,
        unknowns=continuum.size,
        held=tuple(hold),
        frequency_hz=frequency,
        moved=tuple(move),
        at=at,
        stiffness=stiffness,
    )
