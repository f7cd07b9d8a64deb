"""Finite elements hold linear fields exactly, and converge as their order promises.

Evidence (Finite elements): patch test, orders 1 to 5: $10^{-11}$; convergence ($p+1$, energy and
eigenvalues $2p$): 0.3, curved ring 0.4
"""

import functools
import math

import ngsolve as ng
import numpy as np
import pytest
from netgen.meshing import IdentificationType
from netgen.occ import Box, OCCGeometry, gp_Pnt
from ngsolve.meshes import MakeStructured2DMesh

from flexstage.elasticity import Continuum, face
from flexstage.elasticity.shapes import METRE
from flexstage.quantities.material import Material

E, NU, RHO = 68.3e9, 0.33, 2710.0
G = E / (2 * (1 + NU))
METAL = Material(name="metal", youngs_modulus=E, poissons_ratio=NU, density=RHO)
B = 7.3e-3

# ------------------------------------------------------------------------------------ patch test


def plane_patch():
    """A skew quadrilateral whose left side is straight, x = 0."""
    shape = face(((0, -3e-3), (11e-3, -5e-3), (14e-3, 6e-3), (0, 4e-3)))
    for edge in shape.edges:
        edge.name = "left" if abs(edge.center.x) < 1e-9 else "others"
    return ng.Mesh(OCCGeometry(shape, dim=2).GenerateMesh(maxh=5))


@functools.cache
def solid_patch(kind):
    """A box whose face at x = 0 is held, in tetrahedra or prisms."""
    shape = Box(gp_Pnt(0, -3, -2), gp_Pnt(9, 4, 3))
    for side in shape.faces:
        side.name = "left" if abs(side.center.x) < 1e-9 else "others"
    if kind == "prisms":
        below, above = shape.faces.Min((0, 0, 1)), shape.faces.Max((0, 0, 1))
        below.Identify(above, "layer", IdentificationType.CLOSESURFACES)
    mesh = ng.Mesh(OCCGeometry(shape).GenerateMesh(maxh=7, parallel_meshing=False))
    types = {element.type for element in mesh.Elements(ng.VOL)}
    assert types == {ng.ET.PRISM if kind == "prisms" else ng.ET.TET}
    return mesh


def spread(part, field):
    """Root of the mean square of a field, with an order that sees its error."""
    order = 2 * part.order + (6 if part.dimension == 2 else 0)
    square = ng.Integrate(ng.InnerProduct(field, field), part.mesh, order=order)
    return math.sqrt(square / ng.Integrate(ng.CoefficientFunction(1.0), part.mesh))


def traction(part, boundary, stress):
    """Load of a constant stress on boundaries."""
    d = part.dimension
    area = part.measure(boundary=boundary) * (B if d == 2 else 1.0)
    outwards = ng.specialcf.normal(d)
    return area * part.mean(
        boundary, ng.CoefficientFunction(tuple(stress.ravel()), dims=(d, d)) * outwards
    )


@pytest.mark.parametrize("order", [1, 2, 4])
@pytest.mark.parametrize("kind", ["triangles", "plane strain", "tetrahedra", "prisms"])
def test_a_linear_field_is_held_exactly(kind, order):
    # nothing moves on x = 0, so that a strain of all components that allows it is left
    slope = np.array([0.7e-3, -1.1e-3, 0.45e-3])
    solid = kind in ("tetrahedra", "prisms")
    d = 3 if solid else 2
    mesh = solid_patch(kind) if solid else plane_patch()
    strain = ".*" if kind == "plane strain" else ""
    part = Continuum(
        mesh, METAL, order=order, thickness=None if solid else B, strain=strain, fixed="left"
    )
    gradient = np.zeros((d, d))
    gradient[:, 0] = slope[:d]
    small = 0.5 * (gradient + gradient.T)
    first = E * NU / (1 - NU**2) if kind == "triangles" else E * NU / ((1 + NU) * (1 - 2 * NU))
    stress = first * np.trace(small) * np.eye(d) + 2 * G * small
    u = part.solve(traction(part, "others", stress))
    exact = ng.CoefficientFunction(tuple(float(g) for g in slope[:d])) * ng.x / METRE
    # rounding times the condition of the stiffness; what is not held is off by some percent
    assert spread(part, part.field(u) - exact) < 1e-11 * 1e-3 * 9e-3
    full = np.zeros((3, 3))
    full[:d, :d] = stress
    full[2, 2] = stress[2, 2] if solid else (first * np.trace(small) if strain else 0.0)
    rest = part.stress(u) - ng.CoefficientFunction(tuple(full.ravel()), dims=(3, 3))
    assert spread(part, rest) < 1e-10 * E * 1e-3


# ------------------------------------------------------------------------------ order of accuracy

LONG, HIGH = 13e-3, 8e-3
XX, YY, XY = (0, 0), (1, 1), (0, 1)


def rectangle(count, order, **how):
    """Triangles, `count` cells high; the diagonals make no direction special."""
    mesh = MakeStructured2DMesh(
        quads=False,
        nx=2 * count,
        ny=count,
        mapping=lambda s, t: (LONG * METRE * s, HIGH * METRE * t),
    )
    return Continuum(mesh, METAL, order=order, thickness=B, **how)


def slopes(counts, errors):
    return np.diff(np.log(errors)) / np.diff(np.log(1 / np.array(counts, dtype=float)))


def error_energy(part, u, first, scale, exact):
    """Strain energy of the error: a difference of two energies would drown in rounding."""
    stress = part.stress(u)
    xx, yy, xy = (
        stress[place] - scale * wanted for place, wanted in zip((XX, YY, XY), exact, strict=True)
    )
    density = xx**2 + yy**2 + 2 * xy**2 - first / (2 * (first + G)) * (xx + yy) ** 2
    return ng.Integrate(density, part.mesh, order=2 * part.order + 6) / (4 * G)


# coarse enough for the last error to stay above rounding, fine enough for the order to show
COUNTS = {1: (8, 16, 32), 2: (6, 12, 24), 3: (4, 8, 16), 4: (3, 6, 12), 5: (2, 4, 8)}


# plane strain is another material to the elements, whatever their order
@pytest.mark.parametrize(
    ("order", "strain"), [*((order, "") for order in (1, 2, 3, 4, 5)), (2, ".*"), (4, ".*")]
)
def test_displacement_converges_with_order_plus_one_and_energy_with_twice_the_order(order, strain):
    x, y = ng.x / METRE, ng.y / METRE
    kx, ky, shift = 2.3 / LONG, 1.7 / HIGH, 0.4
    first = E * NU / ((1 + NU) * (1 - 2 * NU)) if strain else E * NU / (1 - NU**2)
    # any smooth field that is nothing on the left side: u = s(x) (f(y), g(y))
    s, ds, dds = x * (1 + kx * x), 1 + 2 * kx * x, 2 * kx
    f, df, ddf = (
        ng.sin(ky * y + shift),
        ky * ng.cos(ky * y + shift),
        -(ky**2) * ng.sin(ky * y + shift),
    )
    g, dg, ddg = ng.exp(ky * y), ky * ng.exp(ky * y), ky**2 * ng.exp(ky * y)
    amplitude = 1e-4
    exact = ng.CoefficientFunction((amplitude * s * f, amplitude * s * g))
    xx, yy = ds * f, s * dg
    xy = 0.5 * (s * df + ds * g)
    sxx, syy, sxy = (first + 2 * G) * xx + first * yy, (first + 2 * G) * yy + first * xx, 2 * G * xy
    body = [
        -((first + 2 * G) * dds * f + first * ds * dg + G * (s * ddf + ds * dg)),
        -((first + 2 * G) * s * ddg + first * ds * df + G * (ds * df + dds * g)),
    ]
    normal = ng.specialcf.normal(2)
    push = ng.CoefficientFunction(
        (sxx * normal[0] + sxy * normal[1], sxy * normal[0] + syy * normal[1])
    )
    counts, far, energies = COUNTS[order], [], []
    for count in counts:
        part = rectangle(count, order, strain=strain, fixed="left")
        load = part.force(".*", ng.CoefficientFunction(tuple(amplitude * b for b in body)))
        others = "right|top|bottom"
        load = load + amplitude * B * part.measure(boundary=others) * part.mean(others, push)
        u = part.solve(load)
        away = part.field(u) - exact
        far.append(spread(part, away))
        energies.append(error_energy(part, u, first, amplitude, (sxx, syy, sxy)))
    # halving the elements shows the order to a few percent
    assert slopes(counts, far)[-1] == pytest.approx(order + 1, abs=0.15)
    assert slopes(counts, energies)[-1] == pytest.approx(2 * order, abs=0.3)


@pytest.mark.parametrize("order", [1, 2, 3, 4, 5])
def test_eigenvalues_converge_with_twice_the_order(order):
    # Sides that slide: u = (a sin(p x) cos(q y), b cos(p x) sin(q y)) are the exact modes, waves of
    # shear where a p + b q = 0 and of pressure where a q = b p
    sides = {"x": "left|right", "y": "top|bottom"}
    p, q = math.pi / LONG, math.pi / HIGH
    shear, pressure = G / RHO, E / (1 - NU**2) / RHO
    waves = [(m, n) for m in range(4) for n in range(3) if m or n]
    squares = [pressure * ((m * p) ** 2 + (n * q) ** 2) for m, n in waves]
    squares += [shear * ((m * p) ** 2 + (n * q) ** 2) for m, n in waves if m and n]
    exact = np.sort(squares)[:3]
    counts = {1: (6, 12, 24), 2: (4, 8, 16), 3: (2, 4, 8), 4: (2, 4, 6), 5: (1, 2, 3)}[order]
    errors = []
    for count in counts:
        part = rectangle(count, order, fixed_components=sides)
        omega, _ = part.modes(3, tolerance=1e-13)
        errors.append(omega**2 / exact - 1)
    # the first mode is a plain cosine, soon exact to rounding; the others bend more
    for k in (1, 2):
        assert slopes(counts, [e[k] for e in errors])[-1] == pytest.approx(2 * order, abs=0.3)
    assert (np.array(errors) > -1e-12).all()  # from above


@pytest.mark.parametrize("order", [1, 2, 3, 4, 5])
def test_curved_sides_keep_the_order(order):
    # a quarter of a ring under pressure on its bore, by Lame: sides curved to the same order
    inner, outer, pressure = 3e-3, 7e-3, 50e6
    shape = face(
        ((inner, 0.0), (outer, 0.0), (0.0, outer), (0.0, inner)),
        (0.0, math.tan(math.pi / 8), 0.0, -math.tan(math.pi / 8)),
    )
    for edge in shape.edges:
        c = edge.center
        edge.name = "bottom" if c.y < 1e-6 else "left" if c.x < 1e-6 else "outside"
        if c.x > 1e-6 and c.y > 1e-6 and math.hypot(c.x, c.y) < 5:
            edge.name = "bore"
    mesh = ng.Mesh(OCCGeometry(shape, dim=2).GenerateMesh(maxh=4))
    first = E * NU / (1 - NU**2)
    a = pressure * inner**2 / (outer**2 - inner**2)
    r2 = (ng.x**2 + ng.y**2) / METRE**2
    b = a * outer**2
    x, y = ng.x / METRE, ng.y / METRE
    scale = ((1 - NU) * a + (1 + NU) * b / r2) / E
    exact = ng.CoefficientFunction((scale * x, scale * y))
    turned = b * (x**2 - y**2) / r2**2
    stresses = (a - turned, a + turned, -2 * b * x * y / r2**2)
    far, energies = [], []
    levels = 4 if order < 4 else 3
    for level in range(levels):
        if level:
            mesh.Refine()
        mesh.Curve(order)
        part = Continuum(
            mesh, METAL, order=order, thickness=B, fixed_components={"x": "left", "y": "bottom"}
        )
        push = -pressure * ng.specialcf.normal(2)
        u = part.solve(B * part.measure(boundary="bore") * part.mean("bore", push))
        far.append(spread(part, part.field(u) - exact))
        energies.append(error_energy(part, u, first, 1.0, stresses))
    counts = 2 ** np.arange(levels)
    assert slopes(counts, far)[-1] > order + 1 - 0.3
    assert slopes(counts, energies)[-1] > 2 * order - 0.4
