r"""A notch with its roots as one spring, condensed from plane finite elements.

One half of the notch is attached to a block as wide as the body behind it. On the line of the neck
it is constrained by symmetry: :math:`u_x = 0` under axial force and moment, :math:`u_y = 0` under
shear, whose fields are antisymmetric. The far end of the block, one and a half of its
widths away, carries the tractions of a beam with the force at the neck. Then

.. math::

    C_{ij} = \int \sigma_i : \varepsilon_j\,\mathrm{d}V - C_{ij}^\mathrm{block}

with the compliance of the block as a beam with shear, from the root on. The difference no longer
depends on the length of the block (the stress of a strip does not depend on its loading beyond
about a width; B. de Saint-Venant 1855): it is the half notch with the deformation of the body at
the root. Two halves in series make the hinge. Where the bodies differ, each half is combined with
its own mirror image; the error is of second order in the effect of the difference of the roots at
the neck.

Lengths are in heights of the root, which are metres to the mesher, so that the size of a notch has
no influence on it; compliances are times E b. The neck is at x = 0, the block at the right.
"""

import math
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from typing import Literal, NamedTuple

import ngsolve as ng
import numpy as np
from netgen.meshing import MeshingParameters
from netgen.occ import (
    ArcOfCircle,
    Edge,
    Face,
    Glue,
    OCCGeometry,
    Segment,
    SplineInterpolation,
    TopoDS_Shape,
    Wire,
    gp_Pnt,
    gp_Vec,
)

from flexstage.base.errors import HingeError
from flexstage.elasticity import Continuum, face
from flexstage.elasticity.resources import parallel
from flexstage.elasticity.shapes import METRE
from flexstage.hinges.hinge_spring import (
    ROOT_REACH,
    HingeCompliance,
    PlaneState,
    plane_moduli,
    strip_compliance,
)
from flexstage.hinges.profile import Array, Profile
from flexstage.quantities.material import Material

_Points = list[tuple[float, float]]

_UPRIGHT = 0.5 * math.pi - 0.05  # a contour that ends steeper than this makes no sharp corner


class _Sizes(NamedTuple):
    """Sizes of the mesh, and of the division of contours for it."""

    neck: float = 0.8
    """Largest element at the neck, in necks, and along the contour, in heights there."""
    corner: float = 1e-2
    """Smallest element in a sharp corner, in necks: 0.04 % on a leaf."""
    curvature: float = 2.5
    """Elements by radius of curvature."""
    notch: float = 0.3
    """Largest element in the notch, in heights of the root."""
    block: float = 0.5
    """Largest element in the block, in its widths."""
    grading: float = 0.5
    """Growth of elements."""
    points: int = 61
    """Points on a curved piece of the contour, to tell an arc from other curves."""
    apart: float = 0.02
    """Points of a spline that are closer, in necks, only spoil it."""
    part: float = 4.0
    """A curve is divided after this many heights."""


_SIZES = _Sizes()
_TOLERANCE = 1e-9


class _Curve(NamedTuple):
    """A smooth part of a contour: points, the height of the notch there, its slope at the ends."""

    points: _Points
    heights: list[float]
    slopes: tuple[float, float]


class HalfNotch(NamedTuple):
    """The half of a notch in body b and its block, in heights of the root."""

    neck: float
    """Thickness of the neck [1]."""
    root: float
    """Distance of the root from the neck [1]."""
    middle: float
    """Distance of the block's middle from the hinge's line, to the left [1]."""
    width: float
    """Width of the block [1]."""
    end: float
    """Distance of the block's end from the neck [1]."""

    def as_beam(self, end: float, poisson: float) -> Array:
        """The compliance about the neck of the block as a beam with shear, from the root on.

        It counts up to `end` from the neck; times E b, shape (3, 3).
        """
        return strip_compliance((self.root, end), self.width, self.middle, poisson)


def half_notch_on_block(profile: Profile, width: float, length: float) -> HalfNotch:
    """Return the measures of the half of a notch on a block.

    The block is `width` heights of the root wide and `length` of its widths long. The measures are
    rounded, so that a notch and its enlargement have one mesh.
    """
    height = profile.root_height
    root = round(0.5 * profile.length / height, 12)
    return HalfNotch(
        neck=round(profile.neck_thickness / height, 12),
        root=root,
        middle=round(0.5 * profile.depth / height, 12) if profile.one_sided else 0.0,
        width=width,
        end=root + length * width,
    )


def half_mesh(profile: Profile, half: HalfNotch, fineness: float) -> ng.Mesh:
    """Mesh the half of a notch and its block.

    Regions ``notch`` and ``body``; edges ``neck``, ``left``, ``right`` (the surfaces of the notch)
    and ``end``; points ``low`` and ``high`` at the ends of the neck. It is not yet curved;
    `fineness` divides the size of the elements.
    """
    t, x0, e, w, x1 = half.neck, half.root, half.middle, half.width, half.end
    left = _contour(profile, 1.0)
    right = _contour(profile, -1.0)
    low, high = right[-1].points[-1][1], left[-1].points[-1][1]
    slopes = (abs(left[-1].slopes[1]), abs(right[-1].slopes[1]))
    # Counter-clockwise, as `face` runs: faces are joined only where their normals agree.
    edges = [
        _edge([(0.0, 0.5 * t), (0.0, -0.5 * t)], (0.0, 0.0)),
        *(_edge(c.points, c.slopes) for c in right),
        _edge([(x0, low), (x0, high)], (0.0, 0.0)),
        *(_edge(c.points, c.slopes) for c in reversed(left)),
    ]
    notch = Face(Wire(edges))
    corners = [(x0, low), (x0, e - 0.5 * w), (x1, e - 0.5 * w), (x1, e + 0.5 * w)]
    corners += [(x0, e + 0.5 * w), (x0, high)]
    corners = [p for p, q in pairwise([*corners, corners[0]]) if math.dist(p, q) > _TOLERANCE]
    body = face(corners)
    notch.faces.name, body.faces.name = "notch", "body"
    notch.faces.maxh = _SIZES.notch / fineness * METRE
    body.faces.maxh = _SIZES.block * w / fineness * METRE
    shape = Glue([notch, body])
    _name_edges(shape, half, _SIZES.neck * t / fineness * METRE)
    for vertex in shape.vertices:
        x, y = vertex.p.x / METRE, vertex.p.y / METRE
        if abs(x) < _TOLERANCE:
            vertex.name = "high" if y > 0.0 else "low"
        for at, slope, edge in ((high, slopes[0], e + 0.5 * w), (low, slopes[1], e - 0.5 * w)):
            # the contour meets a wider body in a sharp corner unless it ends upright
            sharp = abs(at - edge) > _TOLERANCE and slope < _UPRIGHT
            if sharp and math.dist((x, y), (x0, at)) < _TOLERANCE:
                vertex.maxh = _SIZES.corner * t * METRE
    sizes = MeshingParameters(
        maxh=max(1.0, w) * _SIZES.block / fineness * METRE,
        grading=_SIZES.grading,
        curvaturesafety=_SIZES.curvature * fineness,
        segmentsperedge=0.2,
    )
    for curves in (left, right):
        _restrict(sizes, curves, fineness)
    mesh = ng.Mesh(OCCGeometry(shape, dim=2).GenerateMesh(sizes))
    # the mesher leaves out what it cannot mesh; straight elements miss a little of the area
    area = sum(part.mass for part in shape.faces)
    if abs(ng.Integrate(ng.CoefficientFunction(1.0), mesh) / area - 1.0) > 0.05:
        raise HingeError(
            f"this {profile.kind} notch could not be meshed: use the method 'wedge', or less "
            "extreme proportions"
        )
    return mesh


def _restrict(sizes: MeshingParameters, curves: list[_Curve], fineness: float) -> None:
    """Keep the elements along a contour below the height of the notch there."""
    last = -1.0
    for curve in curves:
        for (x, y), height in zip(curve.points, curve.heights, strict=True):
            size = _SIZES.neck * height / fineness
            if x - last > 0.5 * size and size < _SIZES.notch / fineness:
                sizes.RestrictH(x * METRE, y * METRE, 0.0, size * METRE)
                last = x


def _name_edges(shape: TopoDS_Shape, half: HalfNotch, at_neck: float) -> None:
    """Name the neck, the two surfaces of the notch and the end of the half."""
    for edge in shape.edges:
        x = [v.p.x / METRE for v in edge.vertices]
        if max(x) < _TOLERANCE:
            edge.name = "neck"
            edge.maxh = at_neck
        elif min(x) > half.end - _TOLERANCE:
            edge.name = "end"
        elif min(x) < half.root - _TOLERANCE:
            edge.name = "left" if sum(v.p.y for v in edge.vertices) > 0.0 else "right"
        else:
            edge.name = "body"


def _contour(profile: Profile, side: float) -> list[_Curve]:
    """Return one side from the neck to the root."""
    unit, neck = profile.root_height, profile.neck_thickness
    if profile.one_sided and side < 0.0:
        y = -0.5 * neck / unit
        ends = [(0.0, y), (round(0.5 * profile.length / unit, 12), y)]
        return [_Curve(ends, [neck / unit, 1.0], (0.0, 0.0))]
    curves = []
    for piece in profile.pieces():
        x, depth, angle, _ = piece(np.linspace(0.0, 1.0, _SIZES.points))
        xy = np.round(np.column_stack([x, side * (0.5 * neck + depth)]) / unit, 12)
        heights = (neck + profile.sides * depth) / unit
        if _on_a_line(xy):
            retained = [0, _SIZES.points - 1]
            cuts = retained
        else:
            retained = _apart(xy, _SIZES.apart * neck / unit)
            cuts = [retained[0], retained[-1]] if _on_a_circle(xy) else _cuts(xy, heights, retained)
        for first, last in pairwise(cuts):
            part = [i for i in retained if first <= i <= last]
            curves.append(
                _Curve(
                    [(float(a), float(b)) for a, b in xy[part]],
                    [float(h) for h in heights[part]],
                    (side * float(angle[first]), side * float(angle[last])),
                )
            )
    return curves


def _apart(xy: Array, least: float) -> list[int]:
    """Remove points that are too close to their neighbours."""
    retained, last = [0], len(xy) - 1
    for i in range(1, last):
        if math.dist(xy[i], xy[retained[-1]]) > least and math.dist(xy[i], xy[last]) > least:
            retained.append(i)
    return [*retained, last]


def _cuts(xy: Array, heights: Array, points: list[int]) -> list[int]:
    """Divide a long curve every few heights: the mesher divides each part evenly."""
    along = np.append(0.0, np.cumsum(np.hypot(*np.diff(xy, axis=0).T)))
    cuts = [points[0]]
    for i in points[2:-2]:
        enough = _SIZES.part * heights[cuts[-1]]
        if along[i] - along[cuts[-1]] > enough and along[-1] - along[i] > enough:
            cuts.append(i)
    return [*cuts, points[-1]]


def _edge(points: _Points, slopes: tuple[float, float]) -> Edge:
    """Return a line, the arc that the points lie on, or else a spline with these end slopes."""
    at = [gp_Pnt(x * METRE, y * METRE, 0.0) for x, y in points]
    if len(at) == 2 or _on_a_line(np.array(points)):
        return Segment(at[0], at[-1])
    if _on_a_circle(np.array(points)):
        return ArcOfCircle(at[0], at[len(at) // 2], at[-1])
    first, last = (gp_Vec(math.cos(a), math.sin(a), 0.0) for a in slopes)
    return SplineInterpolation(at, tangents={0: first, len(at) - 1: last})


def _on_a_line(points: Array) -> bool:
    """Return whether points lie on the line through the first and the last."""
    along = (points[-1] - points[0]) / math.dist(points[-1], points[0])
    off = (points - points[0]) @ np.array([-along[1], along[0]])
    return bool(np.max(np.abs(off)) < 1e-8)


def _on_a_circle(points: Array) -> bool:
    """Return whether points lie on the circle through the first, the middle and the last."""
    start, others = points[0], points[[len(points) // 2, -1]] - points[0]
    centre = start + np.linalg.solve(others, 0.5 * np.sum(others**2, axis=1))
    radii = np.hypot(*(points - centre).T)
    return bool(np.ptp(radii) < 1e-9)


# Order 5 with an element or two across the neck: within 0.05 % of order 8 on finer meshes. Stress
# is a derivative, and wants more of both.
ORDER, STRESS_ORDER, STRESS_FINENESS = 5, 7, 2.0
BLOCK = 1.5  # length of the block, in its widths: 1 leaves 0.03 %, 2.5 changes nothing

# The thinnest neck that is meshed, against length and height of the notch: rounding grows like the
# fourth power. And the widest body, in heights of the root.
SMALLEST_NECK, WIDEST_BODY = 5e-3, 100.0

_MODULUS = 1e9  # of the model; compliances are times E b
_SIDES, _MIRROR = ("left", "right"), np.diag([1.0, -1.0, 1.0])


@dataclass(frozen=True, slots=True, kw_only=True)
class SurfaceStress:
    """Stress along the surface of a notch, on nominal stress at its neck; left, then right.

    The left surface is the one that a one-sided notch is cut from.
    """

    axial: tuple[float, float]
    """Factor on N/(b t) at the neck; of a notch with a flat part, the largest of its surface [1].
    """
    bending: tuple[float, float]
    """The same on 6 M/(b t^2) [1]."""
    largest_axial: tuple[float, float]
    """Factor on N/(b t) where it is largest along the surface, wherever that is [1]."""
    largest_bending: tuple[float, float]
    """The same on 6 M/(b t^2) [1]."""


def condensed_compliance(
    profile: Profile,
    modulus: float,
    poisson: float,
    width: float,
    plane: PlaneState,
    root_widths: tuple[float, float] | None = None,
    *,
    reach: float | tuple[float, float] = ROOT_REACH,
) -> HingeCompliance:
    r"""Return the compliance of a notch about its neck, by plane finite elements.

    With `root_widths` it includes the notch, the deformation of the bodies at the roots, and the
    bodies' own bending as strips over `reach`; without it, the notch alone, on blocks of the height
    of its root. The notch is in the given plane state, alone to its end; bodies are in plane
    stress.

    `root_widths` below the height of the root count as that, and above 100 of them as 100 [m].
    `reach` is the length over which the bending of body a and of body b counts, in heights of the
    root [1]: 0 next to bodies that are elastic themselves. A neck below 0.005 of the notch's length
    or height is refused.

    Notes
    -----
    Validity: small deformation. Of its plane problem the result is within 0.05 %. A body that is a
    strip along the hinge is covered; one of another shape is to the extent that a strip stands
    for it. Plane strain in the notch and plane stress in the bodies follow three dimensions where a
    neck is many times wider than thick: 1.5 % too stiff on a piece 20 necks wide, where plane
    stress is 10.4 % too soft.

    Examples
    --------
    >>> from flexstage.hinges import RightCircular
    >>> notch = RightCircular(neck_thickness=0.5e-3, radius=1e-3)
    >>> spring = condensed_compliance(notch, 71.7e9, 0.33, 10e-3, "stress")
    >>> round(float(1.0 / spring.matrix[2, 2]), 3)
    8.147
    """
    height = profile.root_height
    reaches = reach if isinstance(reach, tuple) else (reach, reach)
    total = np.zeros((3, 3))
    for which, turn in enumerate((_MIRROR, np.eye(3))):
        if root_widths is None:
            half = _half(profile, poisson, plane, None)
        else:
            body = _relative(profile, root_widths[which])
            block = half_notch_on_block(profile, body, BLOCK)
            half = _half(profile, poisson, plane, body)
            half = half + block.as_beam(block.root + reaches[which], poisson)
        total += turn @ half @ turn
    to_metres = np.diag([1.0, 1.0, 1.0 / height])
    c = to_metres @ total @ to_metres / (modulus * width)
    return HingeCompliance(matrix=0.5 * (c + c.T), method="finite-element", plane=plane)


@lru_cache(maxsize=1024)
def surface_stress(
    profile: Profile,
    poisson: float,
    plane: PlaneState = "stress",
    root_width: float | None = None,
) -> SurfaceStress:
    """Return the stress along the surface of a notch, by plane finite elements.

    `root_width` is the width of the bodies behind the roots [m], that of the root where None. A
    contour with a sharp corner at the end of its neck is refused: the stress is infinite there.

    Notes
    -----
    Validity: small deformation; within 0.02 % of the plane problem. A sharp corner where a notch
    meets a wider body is excluded.

    Examples
    --------
    >>> from flexstage.hinges import RightCircular
    >>> found = surface_stress(RightCircular(neck_thickness=0.4e-3, radius=1e-3), 0.33)
    >>> round(found.bending[0], 3)
    1.077
    """
    if profile.step > 0.0:
        raise HingeError(
            f"a {profile.kind} notch has sharp corners, where the stress is infinite: give it "
            "fillets (corner-filleted) to evaluate it"
        )
    body = None if root_width is None else _relative(profile, root_width)
    # more threads are no faster on so few elements
    with parallel(1):
        model = _Model(profile, poisson, plane, body, order=STRESS_ORDER, fineness=STRESS_FINENESS)
        stress = {(n, side): model.surface_stress(n, side) for n in "NM" for side in _SIDES}
    t = model.block.neck
    nominal = {"N": 1.0 / t, "M": 6.0 / t**2}

    def factors(name: Literal["N", "M"], place: int) -> tuple[float, float]:
        left, right = (stress[name, side][place] / nominal[name] for side in _SIDES)
        return left, right

    place = 1 if profile.flat_length > 0.0 else 0
    return SurfaceStress(
        axial=factors("N", place),
        bending=factors("M", place),
        largest_axial=factors("N", 1),
        largest_bending=factors("M", 1),
    )


# --------------------------------------------------------------------------- one half


@lru_cache(maxsize=4096)
def _half(profile: Profile, poisson: float, plane: PlaneState, body: float | None) -> Array:
    """Compliance of the half in body b without its block, times E b, in heights of the root."""
    # more threads are no faster on so few elements
    with parallel(1):
        half_compliance = _Model(profile, poisson, plane, body).compliance()
    half_compliance.flags.writeable = False
    return half_compliance


def _relative(profile: Profile, root_width: float) -> float:
    """Width of a body in heights of the root."""
    return round(float(np.clip(root_width / profile.root_height, 1.0, WIDEST_BODY)), 9)


class _Model:
    """Finite elements of the half in body b, under the three forces at the neck."""

    def __init__(
        self,
        profile: Profile,
        poisson: float,
        plane: PlaneState,
        body: float | None,
        *,
        order: int = ORDER,
        fineness: float = 1.0,
        length: float = BLOCK,
    ) -> None:
        slender = profile.neck_thickness / max(profile.length, profile.root_height)
        if slender < SMALLEST_NECK:
            raise HingeError(
                f"the neck of this {profile.kind} notch, {profile.neck_thickness!r} m, is too thin "
                f"to mesh: it must be at least {SMALLEST_NECK:g} of its length and height; "
                "use the method 'wedge'"
            )
        self.order = order
        self.block = half_notch_on_block(profile, 1.0 if body is None else body, length)
        self.mesh = half_mesh(profile, self.block, fineness)
        self.mesh.Curve(order)
        self.body_is_strain = body is None and plane == "strain"
        self.poisson = poisson
        strained = (["notch"] if plane == "strain" else []) + ["body"] * self.body_is_strain
        material = Material(
            name="unit", youngs_modulus=_MODULUS, poissons_ratio=poisson, density=1.0
        )

        def constrained(components: dict[str, str]) -> Continuum:
            return Continuum(
                self.mesh,
                material,
                order=order,
                thickness=1.0,
                strain="|".join(strained),
                fixed_components=components,
            )

        # "_bbnd": single points, which hold what is left of rigid motion and carry no force
        even = constrained({"x": "neck", "y_bbnd": "low"})
        odd = constrained({"y": "neck", "x_bbnd": "low|high"})
        b = self.block
        self.load = {
            "N": self._end_load(even, 1.0, 0.0, b.middle),
            "V": self._end_load(odd, 0.0, 1.0, -b.end),
            "M": self._end_load(even, 0.0, 0.0, 1.0),
        }
        self.part = {"N": even, "V": odd, "M": even}
        self.motion = {name: self.part[name].solve(f) for name, f in self.load.items()}

    def _end_load(self, part: Continuum, axial: float, shear: float, moment: float) -> Array:
        """Tractions of a beam at the end of the block: forces there, moment about its middle."""
        w = self.block.width
        y = ng.y / METRE - self.block.middle
        along = axial - 12.0 * moment / w**2 * y
        across = 1.5 * shear * (1.0 - 4.0 / w**2 * y**2)
        return part.mean("end", ng.CoefficientFunction((along, across)))

    def compliance(self) -> Array:
        """Return the compliance without the block, times E b, shape (3, 3)."""
        f, u = self.load, self.motion
        c = np.zeros((3, 3))
        c[0, 0], c[1, 1], c[2, 2] = f["N"] @ u["N"], f["V"] @ u["V"], f["M"] @ u["M"]
        c[0, 2] = c[2, 0] = f["N"] @ u["M"]
        # the two kinds of field meet in their energy only: they are held differently at the neck
        stress = self.part["V"].stress(u["V"])
        for i, name in ((0, "N"), (2, "M")):
            strain = METRE * ng.Sym(ng.Grad(self.part[name].field(u[name])))
            density = stress[0, 0] * strain[0, 0] + stress[1, 1] * strain[1, 1]
            density += 2.0 * stress[0, 1] * strain[0, 1]
            # compiled, what the components share is computed once
            energy = ng.Integrate(density.Compile(), self.mesh, order=2 * self.order) / METRE**2
            c[1, i] = c[i, 1] = energy
        if not self.block.middle:
            # tension of a notch cut from both sides is even about the hinge, the others are odd
            c[0, 1:] = c[1:, 0] = 0.0
        modulus, poisson = plane_moduli(
            _MODULUS, self.poisson, "strain" if self.body_is_strain else "stress"
        )
        block = self.block.as_beam(self.block.end, poisson) * (_MODULUS / modulus)
        return _MODULUS * c - block

    def surface_stress(self, name: str, side: str) -> tuple[float, float]:
        """Return the stress along a surface for a unit force: at the neck, and the largest."""
        stress = self.part[name].stress(self.motion[name])
        # across a free surface there is none, so the trace is the stress along it
        along = ng.BoundaryFromVolumeCF((stress[0, 0] + stress[1, 1]).Compile())
        at = [(float(s), 0.0, 0.0) for s in np.linspace(0.0, 1.0, 13)]
        rule = ng.IntegrationRule(points=at, weights=[0.0] * len(at))
        points = self.mesh.MapToAllElements({ng.ET.SEGM: rule}, self.mesh.Boundaries(side))
        x = np.ravel(ng.x(points)) / METRE
        values = np.abs(np.ravel(along(points)))
        # a sharp corner at the root is no part of the notch
        inside = values[x < 0.98 * self.block.root]
        return float(values[np.argmin(x)]), float(np.max(inside))
