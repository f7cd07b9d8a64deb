r"""Meshed beams against the closed solutions of beams, columns, the elastica and hot bars.

Evidence (Finite elements): cantilever (Timoshenko): 0.028 h/L from the clamp; columns (Euler,
Engesser): $2\cdot10^{-4}$; large bending (elastica): $4\cdot10^{-4}$; heated bars: $10^{-6}$
"""

import math

import ngsolve as ng
import numpy as np
import pytest
from netgen.occ import Box, OCCGeometry, Rectangle, gp_Pnt
from scipy.optimize import brentq
from scipy.special import ellipe, ellipeinc, ellipk, ellipkinc

from flexstage.base.errors import ConvergenceError, ModelError
from flexstage.elasticity import Continuum
from flexstage.elasticity.loaded import (
    COMPONENTS,
    Loaded,
    buckling,
    follow_drive,
    follow_load,
    green_strain,
    stress_stiffening,
    von_mises,
    von_mises_of,
)
from flexstage.elasticity.shapes import METRE
from flexstage.quantities.material import Material

E, NU, RHO, ALPHA = 68.3e9, 0.33, 2710.0, 23.1e-6
G = E / (2 * (1 + NU))
METAL = Material(
    name="metal",
    youngs_modulus=E,
    poissons_ratio=NU,
    density=RHO,
    thermal_expansion=ALPHA,
)
B = 7.3e-3  # thickness of the plane parts


def strip(length, height, *, size=None, order=4, **how):
    """Beam along x from 0 to its length, y from -height/2 to height/2 [m]."""
    shape = Rectangle(length * METRE, height * METRE).Face().Move((0, -0.5 * height * METRE, 0))
    names = {0.0: "left", round(length * METRE, 6): "right"}
    for edge in shape.edges:
        side = "top" if edge.center.y > 0 else "bottom"
        edge.name = names.get(round(edge.center.x, 6), side)
    geometry = OCCGeometry(shape, dim=2)
    mesh = ng.Mesh(geometry.GenerateMesh(maxh=(size or 4 * height) * METRE))
    return Continuum(mesh, METAL, order=order, thickness=B, **how)


def bar(length, height, width, *, order=2, size=None, **how):
    """Beam along x as `strip`, with its width along z."""
    shape = Box(
        gp_Pnt(0, -0.5 * height * METRE, -0.5 * width * METRE),
        gp_Pnt(length * METRE, 0.5 * height * METRE, 0.5 * width * METRE),
    )
    for face in shape.faces:
        c = face.center
        face.name = {0.0: "left", round(length * METRE, 6): "right"}.get(round(c.x, 6), "side")
        if face.name == "side":
            along = "y" if abs(c.y) > 1e-6 else "z"
            face.name = f"{along}{'+' if c.y + c.z > 0 else '-'}"
    # threads of the mesher wait in circles
    made = OCCGeometry(shape).GenerateMesh(
        maxh=(size or 2 * height) * METRE, parallel_meshing=False
    )
    mesh = ng.Mesh(made)
    return Continuum(mesh, METAL, order=order, **how)


def interpolate(part, *components):
    """Degrees of freedom of a displacement given in metres of metres."""
    function = part.field(np.zeros(part.size))
    function.Set(ng.CoefficientFunction(components))
    return function.vec.FV().NumPy().copy()


def without_rigid(part, u):
    """Displacements less their mean rigid motion."""
    (cx, cy), rows = part.rigid_motion(".*")
    a, b, turn = rows @ u
    x, y = ng.x / METRE - cx, ng.y / METRE - cy
    return u - interpolate(part, a - turn * y, b + turn * x)


def greatest(part, stress):
    """Root of the mean square of a stress [Pa]."""
    square = ng.Integrate(ng.InnerProduct(stress, stress), part.mesh)
    return math.sqrt(square / ng.Integrate(ng.CoefficientFunction(1.0), part.mesh))


# ------------------------------------------------------------------------------- small bending


@pytest.mark.parametrize("strain", ["", ".*"])
def test_shear_bending_is_the_exact_solution(strain):
    # Timoshenko and Goodier 1970, Theory of Elasticity, art. 21: parabolic shear on both ends and
    # the moment on the left one. Cubic, so that order 3 holds it; the part floats on a shift.
    length, height, force = 41e-3, 9e-3, 83.0
    inertia = B * height**3 / 12
    e, nu = (E / (1 - NU**2), NU / (1 - NU)) if strain else (E, NU)
    shift = 1e-9 * E / RHO / length**2
    part = strip(length, height, size=11e-3, order=3, strain=strain, shift=shift)
    x, y = ng.x / METRE, ng.y / METRE
    shear = force / (2 * inertia) * (height**2 / 4 - y**2)
    area = B * height
    load = area * part.mean("right", ng.CoefficientFunction((0, shear)))
    normal = force * length * y / inertia  # the face looks towards -x
    load += area * part.mean("left", ng.CoefficientFunction((normal, -shear)))
    u = part.solve(load)
    scale = force / (6 * e * inertia)
    exact = interpolate(
        part,
        -scale * y * ((6 * length - 3 * x) * x + (2 + nu) * (y**2 - height**2 / 4)),
        scale
        * (
            3 * nu * y**2 * (length - x)
            + (4 + 5 * nu) * height**2 * x / 4
            + (3 * length - x) * x**2
        ),
    )
    # the shift is 1e-9 of a wave's square and some 1e-7 of the first bending frequency's
    np.testing.assert_allclose(
        without_rigid(part, u), without_rigid(part, exact), atol=1e-6 * np.abs(exact).max()
    )


@pytest.mark.parametrize(("length", "height"), [(61e-3, 2.3e-3), (23e-3, 2.3e-3)])
def test_clamped_cantilever_bends_as_timoshenko(length, height):
    part = strip(length, height, fixed="left", size=2e-3)
    tip = part.mean("right", (0, 1), 1 - (ng.y / (0.5 * height * METRE)) ** 2)
    area = B * height
    bending = length**3 / (3 * E * area * height**2 / 12)
    shear = 6 / 5 * length / (G * area)
    compliance = float(tip @ part.solve(tip))
    # A clamp also keeps the height of its section, which acts as 0.01 heights less of length:
    # 0.03 height/length of the deflection. Shear is six times that of the short beam.
    assert bending < compliance < bending + shear
    assert compliance == pytest.approx(bending + shear, rel=0.035 * height / length)


# ------------------------------------------------------------------------------------- columns


@pytest.mark.parametrize(
    ("locked", "expected"),
    [
        # Timoshenko and Gere 1961, Theory of Elastic Stability, art. 2.1-2.2: P L^2 / (E I)
        ("", math.pi**2 / 4),
        ("aside", 4.493409458**2),
        ("turn", math.pi**2),
        ("aside, turn", 4 * math.pi**2),
    ],
    ids=["clamped-free", "clamped-pinned", "clamped-guided", "clamped-clamped"],
)
def test_columns_buckle_as_euler_says(locked, expected):
    height = 1.7e-3
    length = 80 * height
    part = strip(length, height, size=8 * height, fixed="left")
    right = part.mean("right", (1, 0))
    ways = {
        "aside": part.mean("right", (0, 1)),
        "turn": part.mean("right", (1, 0), 1 + ng.y / (METRE * height)) - right,
    }
    rows = [row for name, row in ways.items() if name in locked]
    found = buckling(part, part.solve(-right), locked=np.array(rows) if rows else None)
    euler = expected * E * B * height**3 / 12 / length**2
    # Engesser's shear takes 1e-4 to 1.6e-3; the clamp shortens by 0.01 heights, 2.5e-4 of the load
    shear = 1.2 * euler / (G * B * height)
    assert found.positive[0] == pytest.approx(euler / (1 + shear), rel=5e-4)
    assert found.negative.size == 0  # pulled, it never buckles


def test_a_square_column_buckles_both_ways():
    # equal bending both ways: the two factors are double but for the mesh
    length, height = 60e-3, 2.6e-3
    part = bar(length, height, height, size=9e-3, order=3, fixed="left")
    u = part.solve(part.mean("right", (-1, 0, 0)))
    euler = math.pi**2 / 4 * E * height**4 / 12 / length**2
    # shear 5e-3/4, the clamp 0.02 height/length, the coarse mesh some 1e-3
    np.testing.assert_allclose(buckling(part, u, count=2).positive, euler, rtol=4e-3)


def test_reversed_load_gives_the_negative_factors_and_scales():
    part = strip(90e-3, 1.3e-3, size=8e-3, fixed="left")
    u = part.solve(part.mean("right", (-1, 0)))
    right, wrong = buckling(part, u, count=2), buckling(part, -3.7 * u, count=2)
    np.testing.assert_allclose(wrong.negative, -right.positive / 3.7, rtol=1e-7)
    assert wrong.positive.size == 0
    # Euler's (3/1)^2, less the shear of the second
    assert right.positive[1] / right.positive[0] == pytest.approx(9.0, rel=5e-3)


def test_buckling_asks_for_a_stressed_part_without_a_shift():
    part = strip(20e-3, 2e-3, fixed="left")
    with pytest.raises(ModelError, match="no stress"):
        buckling(part, np.zeros(part.size))
    with pytest.raises(ModelError, match="shift"):
        buckling(strip(20e-3, 2e-3, shift=1.0), np.zeros(part.size))


# -------------------------------------------------------------------------- large displacement


def elastica(alpha):
    """Tip (x, y)/L of an inextensible cantilever under a dead end load alpha E I/L^2.

    Bisshopp and Drucker 1945, Q. Appl. Math. 3, 272: equations 11 to 14.
    """

    def incomplete(k2):
        return math.asin(1 / math.sqrt(2 * k2))

    def lack(k2):
        return ellipk(k2) - ellipkinc(incomplete(k2), k2) - math.sqrt(alpha)

    k2 = brentq(lack, 0.5 + 1e-12, 1 - 1e-12, xtol=1e-15)
    depth = 1 - 2 / math.sqrt(alpha) * (ellipe(k2) - ellipeinc(incomplete(k2), k2))
    return math.sqrt(2 * (2 * k2 - 1) / alpha), depth


def test_the_elastica_oracle_gives_its_published_numbers():
    # Bisshopp and Drucker's curve at P L^2 / (E I) = 1 and 10, in the table of Mattiasson 1981,
    # Int. J. Numer. Methods Eng. 17, 145: w/L = 0.30172, 0.81061; u/L = 0.05643, 0.55500
    for alpha, w, u in ((1.0, 0.30172, 0.05643), (10.0, 0.81061, 0.55500)):
        x, y = elastica(alpha)
        assert (y, 1 - x) == pytest.approx((w, u), abs=6e-6)


@pytest.mark.parametrize("strain", ["", ".*"])
def test_cantilever_bends_into_the_elastica(strain):
    height = 0.7e-3
    length = 100 * height
    modulus = E / (1 - NU**2) if strain else E
    part = strip(length, height, size=6 * height, fixed="left", strain=strain)
    unit = modulus * B * height**3 / 12 / length**2
    alphas = np.array([0.4, 2.5, 7.0])
    tip = part.mean("right", (0, 1))
    path = follow_load(part, tip, alphas * unit)
    x = 1 + path.displacement @ part.mean("right", (1, 0)) / length
    y = path.displacement @ tip / length
    expected = np.array([elastica(a) for a in alphas])
    # shear and stretch are (h/L)^2 = 1e-4 of the motion, the clamp 0.03 h/L = 3e-4
    np.testing.assert_allclose(np.column_stack([x, y]), expected, atol=4e-4)
    # the same states, when the motion is imposed instead, and the slope along the path
    driven = follow_drive(part, tip, y * length)
    np.testing.assert_allclose(driven.force, alphas * unit, rtol=1e-7)
    np.testing.assert_allclose(driven.displacement, path.displacement, atol=1e-8 * length)
    # a dead load takes its share of the force from the drive
    helped = follow_drive(part, tip, y * length, load=0.6 * unit * tip)
    np.testing.assert_allclose(helped.force, (alphas - 0.6) * unit, atol=1e-7 * unit)
    slope = (elastica(2.501)[1] - elastica(2.499)[1]) / 0.002 * length / unit
    assert driven.compliance[1] == pytest.approx(slope, rel=2e-3)
    # the tangent written out agrees with the derivative of the energy
    about = Loaded(part, path.displacement[2])
    assert float(tip @ about.solve(tip)) == pytest.approx(driven.compliance[2], rel=1e-6)


def test_a_rigid_turn_of_any_size_strains_nothing():
    flat, solid = strip(17e-3, 5e-3, order=2), bar(17e-3, 5e-3, 3e-3)
    c, s = math.cos(2.1) - 1, math.sin(2.1)
    x, y = ng.x / METRE, ng.y / METRE
    for part, rest in ((flat, ()), (solid, (0.013,))):
        u = interpolate(part, c * x - s * y + 0.2, s * x + c * y - 0.4, *rest)
        assert greatest(part, E * green_strain(ng.Grad(part.field(u)))) < 1e-10 * E
        assert greatest(part, part.stress(u)) > E  # what small displacements would say


def test_solid_and_plane_leaf_bend_alike():
    # Held across its width at both faces, the solid is the part in plane strain; what is left is
    # its coarse mesh.
    length, height, width = 12e-3, 1.1e-3, 2.3e-3
    solid = bar(
        length, height, width, size=2.5e-3, order=3, fixed="left", fixed_components={"z": "z.*"}
    )
    flat = strip(length, height, size=2e-3, fixed="left", strain=".*")
    aside = 0.3 * length
    one = follow_drive(solid, solid.mean("right", (0, 1, 0)), [aside])
    two = follow_drive(flat, flat.mean("right", (0, 1)), [aside])
    assert one.force[0] / width == pytest.approx(two.force[0] / B, rel=5e-3)
    assert one.compliance[0] * width == pytest.approx(two.compliance[0] * B, rel=5e-3)


@pytest.mark.parametrize("share", [0.8, -0.7])
def test_a_pinned_beam_is_tuned_by_its_axial_force(share):
    # Half of a pinned beam: omega^2 = k^2 (E I k^2 + N) / (rho A), k = pi / (2 l)
    height = 1.3e-3
    length = 150 * height
    part = strip(length, height, size=15 * height, fixed_components={"x": "left", "y": "right"})
    k = math.pi / (2 * length)
    critical = E * B * height**3 / 12 * k**2
    path = follow_load(part, part.mean("right", (1, 0)), [share * critical])
    omega, _ = stress_stiffening(part, path.displacement[0], 1)
    free = part.modes(1)[0]
    # Shear and the inertia of the turn are 1e-4. The pinned end keeps its height and so is squeezed
    # across by nu times the axial stress, which turns with it: 5e-4 of the force, here of 0.3 left.
    assert omega[0] / free[0] == pytest.approx(math.sqrt(1 + share), rel=2e-3)
    assert free[0] == pytest.approx(k * math.sqrt(critical / (RHO * B * height)), rel=2e-3)


def test_stability_ends_at_the_buckling_load():
    part = strip(90e-3, 1.3e-3, size=8e-3, fixed="left")
    push = part.mean("right", (-1, 0))
    factor = buckling(part, part.solve(push)).positive[0]
    # the column gets (shorter and thicker) a share of the strain, 2e-4, away from linear theory
    path = follow_load(part, push, factor * np.array([0.998, 1.002]))
    assert stress_stiffening(part, path.displacement[0], 1)[0][0] > 0
    with pytest.raises(ModelError, match="beyond buckling"):
        stress_stiffening(part, path.displacement[1], 1)


def test_what_has_no_equilibrium_is_said():
    loose = strip(20e-3, 2e-3, shift=1.0)
    with pytest.raises(ModelError, match="the part is not constrained"):
        follow_load(loose, np.zeros(loose.size), [1.0])
    part = strip(20e-3, 2e-3, fixed="left")
    with pytest.raises(ModelError, match="degrees of freedom"):
        follow_drive(part, np.ones(3), [1.0])
    with pytest.raises(ModelError, match="reads no free displacement"):
        follow_drive(part, np.zeros(part.size), [1.0])
    with pytest.raises(ConvergenceError, match="reading of the drive of"):
        # past its clamp: the part would have to be squeezed to less than nothing
        follow_drive(part, part.mean("right", (-1, 0)), [25e-3], most_halvings=2)


# ---------------------------------------------------------------------------------------- heat


@pytest.mark.parametrize("strain", ["", ".*"])
def test_a_free_part_grows_without_stress(strain):
    length, height, hot = 31e-3, 7e-3, 41.0
    held = {"x": "left", "y": "bottom"}
    part = strip(length, height, order=2, strain=strain, fixed_components=held)
    u = part.solve(part.thermal(hot))
    grown = interpolate(
        part, ALPHA * hot * ng.x / METRE, ALPHA * hot * (ng.y / METRE + 0.5 * height)
    )
    np.testing.assert_allclose(u, grown, atol=1e-11 * length)
    assert greatest(part, part.stress(u, hot)) < 1e-9 * E * ALPHA * hot


def test_a_free_solid_grows_without_stress():
    hot = -63.0
    part = bar(19e-3, 5e-3, 7e-3, fixed_components={"x": "left", "y": "y-", "z": "z-"})
    u = part.solve(part.thermal(hot))
    grown = [ALPHA * hot * c / METRE for c in (ng.x, ng.y + 2.5, ng.z + 3.5)]
    np.testing.assert_allclose(u, interpolate(part, *grown), atol=1e-11 * 19e-3)
    assert greatest(part, part.stress(u, hot)) < 1e-9 * E * ALPHA * abs(hot)


@pytest.mark.parametrize(
    ("kind", "factor"), [("stress", 1.0), ("strain", 1 / (1 - NU**2)), ("solid", 1.0)]
)
def test_a_bar_between_walls_is_squeezed(kind, factor):
    # -E alpha T; in plane strain the thickness grows by alpha T and no more, so that Poisson's
    # ratio adds as it does to any strain
    hot, walls = 37.0, {"x": "left|right"}
    if kind == "solid":
        part = bar(21e-3, 5e-3, 7e-3, fixed_components=walls | {"y": "y-", "z": "z-"})
    else:
        strain = ".*" if kind == "strain" else ""
        part = strip(21e-3, 5e-3, order=2, strain=strain, fixed_components=walls | {"y": "bottom"})
    stress = part.stress(part.solve(part.thermal(hot)), hot)
    expected = np.zeros((3, 3))
    expected[0, 0] = -factor * E * ALPHA * hot
    if kind == "strain":
        expected[2, 2] = NU * expected[0, 0]
    wanted = ng.CoefficientFunction(tuple(expected.ravel()), dims=(3, 3))
    assert greatest(part, stress - wanted) < 1e-9 * E * ALPHA * hot


@pytest.mark.parametrize("order", [2, 3])
@pytest.mark.parametrize("strain", ["", ".*"])
def test_a_linear_gradient_bends_without_stress(strain, order):
    # u = (alpha g x y, alpha g (y^2 - x^2) / 2), stress-free (Boley and Weiner 1960, sec. 4.1)
    length, height, gradient = 33e-3, 6e-3, 9e3
    shift = 1e-9 * E / RHO / length**2
    part = strip(length, height, order=order, strain=strain, shift=shift)
    change = gradient * ng.y / METRE
    u = part.solve(part.thermal(change))
    x, y = ng.x / METRE, ng.y / METRE
    bent = interpolate(part, ALPHA * gradient * x * y, ALPHA * gradient * 0.5 * (y**2 - x**2))
    np.testing.assert_allclose(
        without_rigid(part, u), without_rigid(part, bent), atol=1e-6 * np.abs(bent).max()
    )
    assert greatest(part, part.stress(u, change)) < 1e-6 * E * ALPHA * gradient * height


# -------------------------------------------------------------------------------- rigid motion


@pytest.mark.parametrize("dimension", [2, 3])
def test_rigid_motion_of_a_rigid_field_is_itself_without_stress(dimension):
    rng = np.random.default_rng(8)
    centre = (0.004, -0.007, 0.011)[:dimension]
    move, turn = rng.uniform(-1, 1, 3) * 1e-4, rng.uniform(-1, 1, 3) * 1e-3
    x, y, z = (c / METRE - at for c, at in zip((ng.x, ng.y, ng.z), (*centre, 0.0), strict=False))
    if dimension == 2:
        part = strip(23e-3, 6e-3, order=1)
        u = interpolate(part, move[0] - turn[2] * y, move[1] + turn[2] * x)
        expected = np.array([move[0], move[1], turn[2]])
    else:
        part = bar(23e-3, 6e-3, 4e-3, order=1)
        u = interpolate(
            part,
            move[0] + turn[1] * z - turn[2] * y,
            move[1] + turn[2] * x - turn[0] * z,
            move[2] + turn[0] * y - turn[1] * x,
        )
        expected = np.concatenate([move, turn])
    at, rows = part.rigid_motion(".*", centre)
    assert at == centre
    np.testing.assert_allclose(rows @ u, expected, rtol=1e-9, atol=1e-13)
    assert greatest(part, part.stress(u)) < 1e-10 * E * 1e-3


# ------------------------------------------------------------------------- the same part twice


@pytest.mark.parametrize("dimension", [2, 3])
def test_a_part_with_supports_is_the_part_that_is_held_so(dimension):
    def made(held):
        if dimension == 2:
            return strip(23e-3, 3e-3, order=3, fixed=held)
        return bar(23e-3, 3e-3, 4e-3, fixed=held)

    first, alone = made("left"), made("left|right")
    other = first.with_supports("left|right")
    pushed = np.random.default_rng(5).standard_normal(first.size)
    before = first.solve(pushed)
    expected = alone.solve(pushed)
    np.testing.assert_allclose(
        other.solve(pushed), expected, rtol=0, atol=1e-12 * abs(expected).max()
    )
    assert abs(before).max() > 2.0 * abs(expected).max()  # the first one is held as it was
    # what one frees, the other still has
    first.release()
    omega = other.modes(2)[0]
    np.testing.assert_allclose(omega, alone.modes(2)[0], rtol=1e-9)
    other.release()
    np.testing.assert_array_equal(first.solve(pushed), before)


def test_a_path_goes_on_with_the_stiffness_that_it_has():
    leaf = strip(30e-3, 0.4e-3, size=3e-3, fixed="left")
    path = follow_drive(leaf, leaf.mean("right", (0, 1)), np.linspace(0, 6e-3, 5)[1:])
    alone = follow_drive(leaf, leaf.mean("right", (0, 1)), [6e-3])
    assert path.force[-1] == pytest.approx(alone.force[-1], rel=1e-10)
    assert path.compliance[-1] == pytest.approx(alone.compliance[-1], rel=1e-5)
    assert max(path.iterations[1:]) < path.iterations[0]


def test_the_stress_of_von_mises_is_that_of_the_principal_stresses():
    """Whatever the axes: half the squares of the differences of the eigenvalues (1913)."""
    random = np.random.default_rng(11)
    half = random.normal(0.0, 3e7, (40, 3, 3))
    tensors = half + np.swapaxes(half, 1, 2)
    principal = np.linalg.eigvalsh(tensors)
    apart = principal - np.roll(principal, 1, axis=1)
    expected = np.sqrt(0.5 * np.sum(apart**2, axis=1))
    components = np.stack([tensors[:, i, j] for i, j in COMPONENTS], axis=-1)
    assert von_mises_of(components) == pytest.approx(expected, rel=1e-12)
    cube = OCCGeometry(Box(gp_Pnt(0, 0, 0), gp_Pnt(1, 1, 1)))
    mesh = ng.Mesh(cube.GenerateMesh(maxh=1.0, parallel_meshing=False))
    for tensor, value in zip(tensors[:4], expected, strict=False):
        constant = ng.CoefficientFunction(tuple(tensor.ravel().tolist()), dims=(3, 3))
        assert von_mises(constant)(mesh(0.3, 0.4, 0.2)) == pytest.approx(value, rel=1e-12)
