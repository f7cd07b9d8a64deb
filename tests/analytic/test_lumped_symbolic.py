r"""The symbolic equations: equal to the numeric ones, reduced exactly, solved in closed form.

Evidence (Stages, tolerances, designs): M and K (symbolic Lagrange equations): $5\cdot10^{-15}$,
*consistency*
"""

import functools
import math
from dataclasses import replace

import numpy as np
import pytest
import sympy as sp
from scipy.linalg import eigh

from flexstage.base.errors import ModelError
from flexstage.lumped import (
    Mechanism,
    RigidBody,
    Sight,
    SpringHinge,
    condense,
    lumped_system,
    nonlinear,
    reduce_by_symmetry,
    symbolic_model,
    transfer_function,
)
from flexstage.lumped.reduction import ReducedModel, find_mirror
from flexstage.lumped.symbolic import SymbolicModel
from flexstage.lumped.symbols import generic_body, generic_hinge
from flexstage.stage.designs import design
from flexstage.system import frequency_response, modes
from flexstage.system.mechanical import RayleighDamping
from flexstage.system.requests import DampingKind
from tests.mechanisms import chain, damped_parallelogram, parallelogram, response


@functools.cache
def model_of(name: str) -> SymbolicModel:
    """The symbolic model of a built-in stage, which several tests look at."""
    return symbolic_model(design(name))


@functools.cache
def coupled() -> SymbolicModel:
    """The symbolic model of a parallelogram whose hinges couple shear and moment."""
    return symbolic_model(parallelogram(coupling=211.0))


@functools.cache
def driven_part() -> ReducedModel:
    """What of it its drive moves, by its symmetry."""
    return reduce_by_symmetry(coupled())


def relative(found: np.ndarray, wanted: np.ndarray) -> float:
    """Largest difference relative to the diagonal, which makes metres and radians comparable."""
    scale = np.sqrt(np.outer(np.diag(wanted), np.diag(wanted)))
    return float(np.abs((found - wanted) / scale).max())


def frequencies(stiffness: np.ndarray, mass: np.ndarray) -> np.ndarray:
    return np.sqrt(eigh(stiffness, mass, eigvals_only=True)) / (2.0 * np.pi)


@pytest.mark.parametrize(
    "name", ["vgtu-piezo", "vgtu-mechanical", "parallelogram", "rhombus", "three-rrr"]
)
def test_matrices_of_stages_equal_the_numeric_ones(name: str) -> None:
    stage = design(name)
    system, model = lumped_system(stage), model_of(name)
    K, M = model.numbers(model.K), model.numbers(model.M)
    assert relative(K, system.K) <= 1e-12
    assert relative(M, system.M) <= 1e-12
    assert np.array_equal(K, K.T)
    # so that roots of them are simplified
    assert all(s.is_positive for s in model.M.free_symbols if s.name[0] in "mJ")
    for found, wanted in zip(
        (*model.drives, *model.probes), (*system.drives, *system.probes), strict=True
    ):
        assert np.allclose(model.numbers(found.vector)[:, 0], wanted.vector, rtol=0.0, atol=1e-12)


@pytest.mark.parametrize("source", [chain(5), parallelogram(coupling=211.0)])
def test_matrices_of_mechanisms_equal_the_numeric_ones(source: Mechanism) -> None:
    model = symbolic_model(source)
    numeric = nonlinear(source)
    assert relative(model.numbers(model.K), numeric.tangent(np.zeros(model.order))) <= 1e-12
    assert np.allclose(np.diag(model.numbers(model.M)), numeric.mass, rtol=1e-13)


@pytest.mark.parametrize("damping", ["rayleigh", "hinge"])
def test_matrices_are_the_hessians_of_the_energies(damping: str) -> None:
    model = symbolic_model(parallelogram(coupling=211.0), damping=damping)  # type: ignore[arg-type]
    q, rates = list(model.coordinates), list(model.rates)
    assert (sp.hessian(model.potential_energy, q) - model.K).applyfunc(sp.expand).is_zero_matrix
    assert (sp.hessian(model.kinetic_energy, rates) - model.M).applyfunc(sp.expand).is_zero_matrix
    assert (sp.hessian(model.dissipation, rates) - model.C).applyfunc(sp.expand).is_zero_matrix
    assert not model.C.is_zero_matrix


def test_equations_of_motion_are_lagranges() -> None:
    model = symbolic_model(parallelogram())
    swap = dict(zip(model.rates, model.accelerations, strict=True))
    for i, equation in enumerate(model.equations()):
        wanted = (
            sp.diff(model.kinetic_energy, model.rates[i]).xreplace(swap)
            - sp.diff(model.kinetic_energy, model.coordinates[i])
            + sp.diff(model.dissipation, model.rates[i])
            + sp.diff(model.potential_energy, model.coordinates[i])
        )
        assert sp.expand(equation.lhs - wanted) == 0
        assert equation.rhs == model.forces[i]


def test_generic_hinge_is_the_small_limit_of_the_turning_frame() -> None:
    # the finite-rotation deformation of the nonlinear model, in symbols, expanded at rest
    g = generic_hinge()
    xa, ya, ta, xb, yb, tb = g.coordinates
    Xa, Ya, Xb, Yb = g.arms
    phi = sp.Symbol("varphi")

    def turn(angle: sp.Expr) -> sp.Matrix:
        return sp.Matrix([[sp.cos(angle), -sp.sin(angle)], [sp.sin(angle), sp.cos(angle)]])

    d = sp.Matrix([xb - xa, yb - ya]) + (turn(tb) - sp.eye(2)) * sp.Matrix([Xb, Yb])
    d -= (turn(ta) - sp.eye(2)) * sp.Matrix([Xa, Ya])
    e = turn(phi + (ta + tb) / 2).T * d
    rest = dict.fromkeys(g.coordinates, 0)
    direction = {g.cosine: sp.cos(phi), g.sine: sp.sin(phi)}
    for i in range(2):
        for q in g.coordinates:
            slope = sp.diff(e[i], q).subs(rest)
            assert sp.simplify(slope - sp.diff(g.deformation[i], q).subs(direction)) == 0


def test_generic_body_has_momenta() -> None:
    body = generic_body()
    assert body.momenta[0] == body.mass * body.rates[0]
    assert body.momenta[2] == body.inertia * body.rates[2]


def test_rigid_motion_of_a_free_mechanism_costs_nothing_in_symbols() -> None:
    model = symbolic_model(chain(3, held=False))
    K = model.numbers(model.K)
    centres = [b.centre for b in model.source.bodies]
    turn = np.array([v for x, y in centres for v in (-y, x, 1.0)])
    shift_x = np.tile([1.0, 0.0, 0.0], 3)
    for motion in (turn, shift_x):
        assert abs(motion @ K @ motion) <= 1e-12 * (np.abs(motion) @ np.abs(K) @ np.abs(motion))


def test_symmetry_keeps_every_frequency_once() -> None:
    model = coupled()
    whole = frequencies(model.numbers(model.K), model.numbers(model.M))
    parts = []
    for parity, order in ((1, 4), (-1, 5)):
        part = reduce_by_symmetry(model, parity=parity)
        assert part.order == order
        parts.append(frequencies(part.numbers(part.K), part.numbers(part.M)))
    assert np.allclose(np.sort(np.concatenate(parts)), whole, rtol=1e-10)
    with pytest.raises(ModelError, match="1 for symmetric or -1 for antisymmetric, got 2"):
        reduce_by_symmetry(model, parity=2)


def test_poles_are_the_frequencies_of_the_symmetric_subspace() -> None:
    model, part = coupled(), driven_part()
    assert [p.name for p in part.drives] == ["push"]
    tf = transfer_function(part, "push", "read")
    poles = np.abs(tf.poles().imag[::2]) / (2.0 * np.pi)
    # determinants are evaluated in rational arithmetic; the roots of degree 5 lose some digits
    wanted = frequencies(part.numbers(part.K), part.numbers(part.M))
    assert np.allclose(poles, wanted, rtol=1e-9)
    # all of them are frequencies of the whole stage
    whole = frequencies(model.numbers(model.K), model.numbers(model.M))
    for pole in poles:
        assert np.abs(whole / pole - 1.0).min() < 1e-9
    assert tf.expression.free_symbols >= {tf.s} | part.K.free_symbols - {tf.s}


def direct(model: SymbolicModel, frequency_hz: float) -> complex:
    """Solve the full equations at one frequency."""
    s = 2j * np.pi * frequency_hz
    M, C, K = (model.numbers(a) for a in (model.M, model.C, model.K))
    w = model.numbers(model.drive("push").vector)[:, 0]
    p = model.numbers(model.probe("read").vector)[:, 0]
    return complex(p @ np.linalg.solve(M * s**2 + C * s + K, w))


@pytest.mark.parametrize(
    ("damping", "numbers"), [("rayleigh", {"alpha": 3.1, "beta": 2.7e-6}), ("none", {})]
)
def test_transfer_function_is_the_response(damping: DampingKind, numbers: dict[str, float]) -> None:
    model = symbolic_model(parallelogram(coupling=211.0), damping=damping).with_values(**numbers)
    tf = transfer_function(reduce_by_symmetry(model), "push", "read")
    for f in (0.0, 87.0, 131.0, 4100.0):
        assert response(tf, f) == pytest.approx(direct(model, f), rel=1e-7)


def test_transfer_function_with_damping_in_hinges_is_the_response() -> None:
    model, _, tf = damped_parallelogram()
    for f in (0.0, 87.0, 131.0, 4100.0):
        assert response(tf, f) == pytest.approx(direct(model, f), rel=1e-7)


def test_slanted_hinges_have_transfer_functions_in_symbols() -> None:
    # the sine and the cosine of one angle are not independent, and yet entries of polynomials
    free = chain(2)
    held = replace(free, hinges=free.hinges[:1], bodies=free.bodies[:2], drives=(), probes=())
    angle = held.hinges[0].direction
    sight = Sight(
        name="push",
        bodies=(0, 1),
        points=((0.01, 0.02), (0.05, 0.03)),
        direction=0.3,
        stiffness=None,
    )
    model = symbolic_model(replace(held, drives=(sight,), probes=(replace(sight, name="read"),)))
    assert abs(math.sin(2.0 * angle)) > 0.1
    assert model.K.atoms(sp.sin, sp.cos)
    tf = transfer_function(model, "push", "read")
    for f in (0.0, 87.0, 4100.0):
        assert response(tf, f) == pytest.approx(direct(model, f), rel=1e-7)


@pytest.mark.parametrize("name", ["vgtu-piezo", "vgtu-mechanical"])
def test_condensation_of_the_study_stages(name: str) -> None:
    stage = design(name)
    system = lumped_system(stage, damping=RayleighDamping(alpha=1.7, beta=3.3e-6))
    model = model_of(name).with_values(alpha=1.7, beta=3.3e-6)
    axis = stage.axis("x")
    small = condense(model)
    assert small.order == 4
    tf = transfer_function(small, axis.drive, axis.probe)
    exact = frequency_response(system, np.array([0.0, 50.0]), drive=axis.drive, probe=axis.probe)
    # static behaviour between drives and probes is exact
    assert response(tf, 0.0) == pytest.approx(exact.value[0], rel=1e-9)
    wanted = modes(system, count=2).frequency_hz
    found = np.sort(np.abs(tf.poles()))[[0, 2]] / (2.0 * np.pi)
    # Guyan's frequencies come from above, here by half a per cent
    assert np.all(found >= wanted * (1.0 - 1e-9))
    assert np.allclose(found, wanted, rtol=0.01)


def test_mirror_is_found_where_there_is_one() -> None:
    mirror = find_mirror(parallelogram(coupling=211.0))
    assert mirror is not None
    assert mirror.direction == pytest.approx(0.5 * np.pi)
    assert np.array_equal(mirror.image @ mirror.image, np.eye(9, dtype=int))
    assert find_mirror(chain(3)) is None


def test_mirror_at_forty_five_degrees() -> None:
    spring = np.diag([4.1e6, 1.3e6, 2.9])

    def leg(name: str, centre: tuple[float, float]) -> RigidBody:
        return RigidBody(name=name, mass=0.013, inertia=4e-7, centre=centre)

    source = Mechanism(
        name="corner",
        bodies=(
            RigidBody(name="frame", mass=1.0, inertia=1.0, centre=(0.0, 0.0), fixed=True),
            leg("one", (0.031, 0.007)),
            leg("two", (0.007, 0.031)),
            RigidBody(name="corner", mass=0.11, inertia=7e-6, centre=(0.03, 0.03)),
        ),
        hinges=tuple(
            SpringHinge(name=f"{a}{b}", bodies=(a, b), at=at, direction=angle, stiffness=spring)
            for a, b, at, angle in (
                (0, 1, (0.031, 0.001), 0.5 * np.pi),
                (0, 2, (0.001, 0.031), 0.0),
                (1, 3, (0.031, 0.015), 0.5 * np.pi),
                (2, 3, (0.015, 0.031), 0.0),
            )
        ),
    )
    model = symbolic_model(source)
    parts = [reduce_by_symmetry(model, parity=p) for p in (1, -1)]
    assert sum(p.order for p in parts) == 9
    found = np.concatenate([frequencies(p.numbers(p.K), p.numbers(p.M)) for p in parts])
    whole = frequencies(model.numbers(model.K), model.numbers(model.M))
    assert np.allclose(np.sort(found), whole, rtol=1e-10)


def test_symbols_are_shared() -> None:
    model = symbolic_model(parallelogram())
    names = {symbol.name for symbol in model.values}
    assert {n for n in names if n.startswith("k_{u")} == {"k_{u1}"}
    assert {n for n in names if n.startswith("m_")} == {"m_1", "m_2"}


def test_mirror_images_share_the_symbol_of_their_angle() -> None:
    # four beams at 0.14 rad, to either side; three legs at 30 and 60 deg to the axes
    for name, angles in (("rhombus", [0.14]), ("three-rrr", [math.pi / 6.0, math.pi / 3.0])):
        values = model_of(name).values
        found = sorted(v for symbol, v in values.items() if symbol.name.startswith("phi"))
        assert found == pytest.approx(angles, rel=1e-13)


def test_a_rhombus_has_a_transfer_function_in_symbols() -> None:
    part = reduce_by_symmetry(model_of("rhombus"))
    poles = np.abs(transfer_function(part, "y", "y").poles().imag[::2]) / (2.0 * np.pi)
    wanted = frequencies(part.numbers(part.K), part.numbers(part.M))
    assert np.allclose(poles, wanted, rtol=1e-9)


def test_errors_say_what_to_do() -> None:
    model = symbolic_model(chain(3))
    with pytest.raises(ModelError, match="reduce it by condensation"):
        reduce_by_symmetry(model)
    with pytest.raises(ModelError, match="at most 6 coordinates"):
        transfer_function(model, "push", "read")
    with pytest.raises(ModelError, match="unknown damping 'viscous'"):
        symbolic_model(chain(3), damping="viscous")  # type: ignore[arg-type]
    with pytest.raises(ModelError, match="no symbol 'gamma'"):
        model.with_values(gamma=1.0)
