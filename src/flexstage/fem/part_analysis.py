"""Analysis of a part from a STEP file by finite elements: mass, modes, stiffness, ratio.

Materials are given as text: a name from the catalogue, or figures; for all solids, or for one.
"""

import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

import ngsolve as ng
import numpy as np

from flexstage.base import progress
from flexstage.base.arrays import Array
from flexstage.base.errors import ModelError, StageError, UnitError
from flexstage.elasticity import Continuum
from flexstage.elasticity.requests import DEFAULT_MATERIAL, PartRequest
from flexstage.fem.interface import (
    MotionRatio,
    interface_modes,
    interface_ratio,
    interface_stiffness,
    require_memory_of,
)
from flexstage.fem.part import Part, PartFace, read_step
from flexstage.fem.part_estimate import PartEstimate, estimate_part, require_room
from flexstage.fem.part_mesh import PartMesh
from flexstage.files.plain import picked
from flexstage.files.result import Result
from flexstage.quantities.material import Material, material
from flexstage.quantities.units import parse

_FIGURES = {"e": ("pressure", "Pa"), "nu": ("", ""), "rho": ("density", "kg/m^3")}


def materials_of(part: Part, texts: Sequence[str]) -> Mapping[str, Material]:
    """Return the material of each solid of a part, by its name.

    Each text is a material for all solids, or ``SOLID=MATERIAL`` with a name or number from 1; a
    material is a name from the catalogue, or ``E=..., nu=..., rho=...``, bare numbers in SI.
    """
    every: Material | None = None
    of: dict[str, Material] = {}
    for text in texts:
        head, sign, rest = text.partition("=")
        if sign and head.strip().casefold() not in _FIGURES:
            name = _solid(part, head.strip())
            if name in of:
                raise StageError(f"solid '{name}' is given two materials: give it one")
            of[name] = _material(rest)
        elif every is not None:
            raise StageError(
                f"'{texts[0]}' and '{text}' are both for all solids: write SOLID=MATERIAL for one "
                f"of {', '.join(part.bodies)}"
            )
        else:
            every = _material(text)
    lacking = [name for name in part.bodies if name not in of]
    if lacking and every is None:
        if texts:
            raise StageError(
                f"solid '{lacking[0]}' has no material: give it one as --material "
                f'"{lacking[0]}=...", or one for all others without a name'
            )
        every = _material(DEFAULT_MATERIAL)
    return {name: of.get(name, every) for name in part.bodies}  # type: ignore[misc]


def _solid(part: Part, word: str) -> str:
    if word in part.bodies:
        return word
    if word.isdigit() and 0 < int(word) <= len(part.bodies):
        return part.bodies[int(word) - 1]
    available = ", ".join(f"{k} {name}" for k, name in enumerate(part.bodies, 1))
    raise StageError(f"{part.source} has no solid '{word}' for the material: it has {available}")


def _material(text: str) -> Material:
    if "=" not in text:
        return material(text.strip())
    figures: dict[str, float] = {}
    for word in text.split(","):
        key, _, value = (w.strip() for w in word.partition("="))
        if key.casefold() not in _FIGURES or key.casefold() in figures:
            raise StageError(
                f"a material is a name, or 'E=193 GPa, nu=0.31, rho=7750 kg/m^3' with each of the "
                f"three once, got '{word.strip()}'"
            )
        dimension, unit = _FIGURES[key.casefold()]
        try:
            figures[key.casefold()] = (
                parse(value, dimension, bare_unit=unit) if dimension else float(value)
            )
        except UnitError as error:
            raise UnitError(f"{key} of the material '{text.strip()}': {error}") from error
        except ValueError as error:
            raise StageError(f"{key} of a material is a plain number, got '{value}'") from error
    missing = [key for key in _FIGURES if key not in figures]
    if missing:
        raise StageError(f"the material '{text.strip()}' lacks {' and '.join(missing)}")
    return Material(
        name=" ".join(text.split()),
        youngs_modulus=figures["e"],
        poissons_ratio=figures["nu"],
        density=figures["rho"],
        source="command line",
    )


class Bodies(Continuum):
    """A part in three dimensions whose regions are of different materials.

    `materials` gives each region's by its name. `fixed` is the regular expression of the fixed
    boundaries, `fixed_components` those of boundaries fixed in one direction, by ``x``, ``y``,
    ``z``; the mesh is curved to `order`, and `shift` is as of `Continuum` [rad^2/s^2].
    """

    def __init__(
        self,
        mesh: ng.Mesh,
        materials: Mapping[str, Material],
        *,
        order: int,
        fixed: str = "",
        fixed_components: Mapping[str, str] | None = None,
        shift: float = 0.0,
    ) -> None:
        regions = list(mesh.GetMaterials())
        lacking = [name for name in regions if name not in materials]
        if lacking:
            raise ModelError(
                f"region '{lacking[0]}' has no material: materials are given for "
                f"{', '.join(materials) or 'none'}"
            )
        of = [materials[name] for name in regions]
        super().__init__(
            mesh,
            of[0],
            order=order,
            fixed=fixed,
            fixed_components=fixed_components,
            shift=shift,
            regions=materials,
        )
        self.material = replace(of[0], name=" + ".join(dict.fromkeys(m.name for m in of)))


_RIGID_MOTIONS = 6
# A part that nothing holds is shifted by this share of the frequency of sound from end to end:
# below its elastic modes, and above what rounding makes of its rigid motions.
_SHIFT = 1e-3
_LEAST, _PATIENCE = (
    60.0,
    20.0,
)  # time of the mesher: so much [s], and as many times the expected one


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class InterfaceResult:
    """A part with one kind of interfaces."""

    frequency_hz: Array
    """Natural frequencies, without rigid motions [Hz], shape (k,)."""
    stiffness: Array | None = None
    """Forces [N] and moments [N m] over displacements [m] and rotations [rad] of the moved faces,
    shape (6, 6).
    """
    ratio: MotionRatio | None = None
    """Motion of the output when two faces are pushed apart."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PartInterface:
    """Faces of a part that touch, and that have one motion where they are fixed or moved."""

    name: str
    """Requested name, with a number where its faces are several interfaces."""
    faces: tuple[int, ...]
    """Numbers of the part's faces."""
    area: float
    """Area [m^2]."""
    centre: tuple[float, ...]
    """Centroid [m]."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PartAnalysis:
    """The analysis of a part, fixed or free."""

    part: Part
    """The part."""
    materials: Mapping[str, Material]
    """Material of each of its bodies."""
    order: int
    """Polynomial order of the displacement."""
    elements: int
    """Elements of the mesh."""
    unknowns: int
    """Unknowns of the mesh."""
    expected: PartEstimate
    """Their estimate before the analysis, with its cost."""
    fixed: tuple[str, ...]
    """Fixed faces; empty for a free part."""
    moved: tuple[str, ...]
    """Faces with a requested stiffness."""
    fixed_interfaces: tuple[PartInterface, ...]
    """Interfaces of the fixed faces."""
    moved_interfaces: tuple[PartInterface, ...]
    """Interfaces of the faces with a requested stiffness."""
    at: tuple[float, ...]
    """The point about which the stiffness is [m]."""
    results: Mapping[str, InterfaceResult]
    """The result by the kind of interfaces, ``rigid`` and ``mean``; of a free part one, ``free``.
    """


def named_faces(part: Part, words: Sequence[str]) -> tuple[str, ...]:
    """Return the faces of a list of words.

    ``x-min``, ``z-max`` and so on stand for the plane faces at that end of the part, and words are
    joined by ``+``.

    Examples
    --------
    >>> from netgen.occ import Box
    >>> part = Part.from_shape(Box((0, 0, 0), (7.0, 2.0, 1.0)))
    >>> named_faces(part, ("x-min",)) == part.select("x", "min")
    True
    """
    names: list[str] = []
    every = {f.name for f in part.faces}
    for word in (w for ws in words for w in ((ws,) if ws in every else ws.split("+"))):
        axis, _, end = word.partition("-")
        if axis in ("x", "y", "z") and end in ("min", "max"):
            names += part.select(axis, end)
        else:
            part.boundary(word)
            names.append(word)
    return tuple(dict.fromkeys(names))


def part_interfaces(part: Part, words: Sequence[str]) -> tuple[PartInterface, ...]:
    """Return the interfaces of a list of words: of each word the groups of faces that touch.

    A face counts for the first word that names it.
    """
    interfaces: list[PartInterface] = []
    selected: set[int] = set()
    for word in words:
        names = named_faces(part, (word,))
        numbers = [k for k, f in enumerate(part.faces) if f.name in names and k not in selected]
        selected.update(numbers)
        groups = part.touching(numbers)
        for n, group in enumerate(groups, 1):
            area, centre = _middle([part.faces[k] for k in group])
            name = f"{word}.{n}" if len(groups) > 1 else word
            interfaces.append(PartInterface(name=name, faces=group, area=area, centre=centre))
    return tuple(interfaces)


def _middle(faces: Sequence[PartFace]) -> tuple[float, tuple[float, ...]]:
    """Return the area [m^2] and the centroid [m] of faces."""
    area = sum(f.area for f in faces)
    return area, tuple(sum(f.area * f.centre[i] for f in faces) / area for i in range(3))


@dataclass(frozen=True, slots=True, kw_only=True)
class _Interfaces:
    """The requested interfaces, and as regular expressions; empty where there are none."""

    constrained: tuple[PartInterface, ...]
    displaced: tuple[PartInterface, ...]
    fixed: tuple[str, ...]
    moved: tuple[str, ...]
    ratio: tuple[str, str, str] | None
    at: tuple[float, ...]
    modes: int


def analyse_part(
    part: Part,
    material: Material | Mapping[str, Material],
    request: PartRequest | None = None,
    *,
    expect: Callable[[PartEstimate], None] | None = None,
) -> PartAnalysis:
    """Analyse a part.

    Without fixed faces it is free. ``rigid`` interfaces move as if stiff plates were welded to
    them; ``mean`` ones may deform, and their mean motion counts. Faces that do not touch are
    interfaces of their own. The displacement has the order of the mesh. `expect` receives the
    estimate of the mesh and its cost beforehand.

    Notes
    -----
    Validity: small displacements, isotropic materials; bodies that share a face are joined there.
    """
    request = request or PartRequest()
    hold, move = named_faces(part, request.hold), named_faces(part, request.move)
    interfaces = _requested_interfaces(part, request, hold, move)
    part.require_joined()
    of = dict.fromkeys(part.bodies, material) if isinstance(material, Material) else dict(material)
    mesh_settings = PartMesh(order=request.order, size=request.size, thin=request.thin)
    interface_kinds = ("rigid", "mean") if request.interfaces == "both" else (request.interfaces,)
    kinds = interface_kinds if hold else ("free",)
    expected = estimate_part(part, mesh_settings, factorisations=_factorisations(kinds, interfaces))
    if expect is not None:
        expect(expected)
    if not request.force:
        require_room(part, mesh_settings, expected)
    progress.update("mesh")
    mesh = part.mesh(mesh_settings, limit=_LEAST + _PATIENCE * expected.meshing)
    for k, name in enumerate(_boundary_names(part)):
        mesh.ngmesh.SetBCName(k, name)
    low, high = part.bounding_box
    sound = min(math.sqrt(m.youngs_modulus / m.density) for m in of.values())
    shift = (_SHIFT * sound / math.dist(low, high)) ** 2
    results: dict[str, InterfaceResult] = {}

    def fixed_part(*more: str) -> Bodies:
        names = "|".join((*interfaces.fixed, *more))
        return _ready(Bodies(mesh, of, order=mesh_settings.order, fixed=names), request.force)

    for k, kind in enumerate(kinds):
        with progress.subtask(0.1 + 0.9 * k / len(kinds), 0.1 + 0.9 * (k + 1) / len(kinds)):
            if kind == "rigid":
                results[kind] = _with_interfaces(interfaces, fixed_part, rigid=True)
                continue
            floating = _ready(
                Bodies(mesh, of, order=mesh_settings.order, shift=shift), request.force
            )
            results[kind] = (
                InterfaceResult(frequency_hz=_free(floating, request.modes))
                if kind == "free"
                else _with_interfaces(interfaces, lambda *_, body=floating: body, rigid=False)
            )
    return PartAnalysis(
        part=part,
        materials=of,
        order=mesh_settings.order,
        elements=mesh.ne,
        unknowns=ng.VectorH1(mesh, order=mesh_settings.order).ndof,
        expected=expected,
        fixed=hold,
        moved=move,
        fixed_interfaces=interfaces.constrained,
        moved_interfaces=interfaces.displaced,
        at=interfaces.at,
        results=results,
    )


def _factorisations(kinds: Sequence[str], interfaces: _Interfaces) -> int:
    """Return their number: one for a free part, one for each set of fixed rigid faces."""
    of_rigid = sum(map(bool, (interfaces.modes, interfaces.moved, interfaces.ratio)))
    return sum(of_rigid if kind == "rigid" else 1 for kind in kinds)


def _requested_interfaces(
    part: Part, request: PartRequest, hold: Sequence[str], move: Sequence[str]
) -> _Interfaces:
    ratio = tuple(named_faces(part, words) for words in request.ratio or ())
    if (move or ratio) and not hold:
        raise StageError("stiffness and ratio refer to fixed faces: name faces to hold")
    for purpose, names in (
        ("moved", move),
        *(("pushed", names) for names in ratio[:2]),
        *(("an output", names) for names in ratio[2:]),
    ):
        both = set(hold) & set(names)
        if both:
            raise StageError(f"face '{min(both)}' cannot be fixed and {purpose}: name it once")
    if ratio and len(set().union(*ratio)) < sum(len(set(names)) for names in ratio):
        raise StageError("the ratio is between three different faces, got one of them twice")
    point: tuple[float, ...] = ()
    if move:
        _, centroid = _middle([f for f in part.faces if f.name in set(move)])
        point = tuple(request.at) if request.at is not None else centroid
    constrained, displaced = (
        part_interfaces(part, words) for words in (request.hold, request.move)
    )
    boundaries = _boundary_names(part)

    def pattern(numbers: Iterable[int]) -> str:
        return "|".join(re.escape(boundaries[k]) for k in numbers)

    patterns = [
        pattern(k for k, f in enumerate(part.faces) if f.name in set(names)) for names in ratio
    ]
    return _Interfaces(
        constrained=constrained,
        displaced=displaced,
        fixed=tuple(pattern(i.faces) for i in constrained),
        moved=tuple(pattern(i.faces) for i in displaced),
        ratio=tuple(patterns) if patterns else None,  # type: ignore[arg-type]
        at=point,
        modes=request.modes,
    )


def _boundary_names(part: Part) -> list[str]:
    """Return names of the boundaries of the mesh, of each face its own."""
    names = [f.name for f in part.faces]
    if len(set(names)) == len(names):
        return names
    return [f"{name}#{k}" for k, name in enumerate(names, 1)]


def _ready(body: Bodies, force: bool) -> Bodies:
    if not force:
        require_memory_of(body)
    body.factorise()
    return body


def _hertz(omega: Array) -> Array:
    return omega / (2.0 * np.pi)


def _free(body: Bodies, modes: int) -> Array:
    """Return the elastic modes; the rigid ones are below them, up to rounding."""
    if not modes:
        return np.zeros(0)
    omega, _ = body.modes(modes + _RIGID_MOTIONS)
    return _hertz(omega[_RIGID_MOTIONS:])


def _with_interfaces(
    interfaces: _Interfaces, part: Callable[..., Bodies], *, rigid: bool
) -> InterfaceResult:
    """Solve with rigid interfaces, one factorisation for each set of fixed faces, or mean ones.

    `part` returns the part with further fixed faces, or the free one.
    """

    def done(body: Bodies) -> None:
        if rigid:  # what floats serves again
            body.release()

    frequency, stiffness, ratio = np.zeros(0), None, None
    if interfaces.modes:
        with progress.subtask(0.0, 0.5):
            body = part()
            omega, _ = (
                body.modes(interfaces.modes)
                if rigid
                else interface_modes(body, interfaces.fixed, interfaces.modes)
            )
            frequency = _hertz(omega)
            done(body)
    if interfaces.moved:
        with progress.subtask(0.5, 0.75):
            progress.update("stiffness")
            body = part(*interfaces.moved)
            stiffness = interface_stiffness(
                body, interfaces.moved, interfaces.fixed, at=interfaces.at, rigid=rigid
            )
            done(body)
    if interfaces.ratio:
        with progress.subtask(0.75, 1.0):
            progress.update("ratio")
            body = part(*interfaces.ratio)
            ratio = interface_ratio(
                body, interfaces.ratio[:2], interfaces.ratio[2], interfaces.fixed, rigid=rigid
            )
    return InterfaceResult(frequency_hz=frequency, stiffness=stiffness, ratio=ratio)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PartResult(Result):
    """Faces and mass of a part, and its modes and stiffness where a mesh was requested."""

    table_key: ClassVar[str] = "faces"

    part: Part
    """The part."""
    materials: Mapping[str, Material]
    """Material of each of its bodies."""
    fixed: tuple[str, ...]
    """Names of the faces to fix."""
    moved: tuple[str, ...]
    """Names of the faces to move."""
    analysis: PartAnalysis | None
    """Analysis; None where not requested."""

    def data(self) -> dict[str, Any]:
        out: dict[str, Any] = {
            "source": self.part.source,
            "volume": self.part.volume,
            "mass": self.part.mass(self.materials),
            "solids": [
                {
                    "name": name,
                    "volume": solid.mass * 1e-9,
                    "material": self.materials[name].name,
                    **picked(self.materials[name], "youngs_modulus", "poissons_ratio", "density"),
                }
                for name, solid in zip(self.part.bodies, self.part.shape.solids, strict=True)
            ],
            "faces": [
                picked(face, "name", "kind", "area", "centre", "solids=bodies")
                for face in self.part.faces
            ],
        }
        if self.analysis is None:
            return out
        analysis = self.analysis
        return out | {
            **picked(analysis, "order", "elements", "unknowns"),
            "expected": picked(analysis.expected, "elements", "unknowns", "memory", "seconds"),
            **picked(analysis, "fixed", "moved", "at"),
            "fixed_interfaces": self._interfaces(analysis.fixed_interfaces),
            "moved_interfaces": self._interfaces(analysis.moved_interfaces),
            "interfaces": {
                kind: picked(r, "natural_frequency_hz=frequency_hz", "stiffness")
                | {
                    "ratio": None
                    if r.ratio is None
                    else picked(r.ratio, "direction", "motion", "ratio", "stiffness")
                }
                for kind, r in analysis.results.items()
            },
        }

    def _interfaces(self, interfaces: Sequence[PartInterface]) -> list[dict[str, Any]]:
        return [
            {
                "faces": [self.part.faces[k].name for k in i.faces],
                **picked(i, "name", "area", "centre"),
            }
            for i in interfaces
        ]


def part_result(
    path: Path, request: PartRequest, *, expect: Callable[[PartEstimate], None] | None = None
) -> PartResult:
    """Read a STEP file, and analyse it where the order of its mesh is not 0."""
    part = read_step(path, solid="all" if "all" in request.solids else request.solids)
    materials = materials_of(part, request.material)
    fixed, moved = named_faces(part, request.hold), named_faces(part, request.move)
    return PartResult(
        request=request,
        part=part,
        materials=materials,
        fixed=fixed,
        moved=moved,
        analysis=analyse_part(part, materials, request, expect=expect) if request.order else None,
    )
