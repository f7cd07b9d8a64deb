r"""Finite rotations: exact gradients, closed-form arcs, conserved energy, the linear limit.

Evidence (Stages, tolerances, designs): nonlinear model at rest (linear model): $10^{-12}$,
*consistency*; energy over 1000 periods: $5\cdot10^{-13}$, *evidence*
"""

import numpy as np
import pytest
from scipy.linalg import eigh

from flexstage.base.arrays import Array
from flexstage.base.errors import ConvergenceError, ModelError
from flexstage.lumped import (
    Mechanism,
    equilibrium,
    lumped_system,
    mechanism,
    motion,
    nonlinear,
    stroke_path,
)
from flexstage.stage.designs import design
from flexstage.stage.designs.parallelogram import ParallelogramParameters
from flexstage.stage.designs.parallelogram import parallelogram as parallelogram_guide
from flexstage.stage.designs.pieces import round_leaf
from flexstage.system import static_displacements
from tests.mechanisms import LEG, chain, parallelogram
from tests.tiers import sizes

# Central differences with step h of quantities of size 1: h^2 + rounding/h, at best some 1e-11.
STEP = 1e-6
DIFFERENCE = 1e-9


def state(order: int, seed: int = 1) -> Array:
    """Centimetres and half radians: nothing is small."""
    random = np.random.default_rng(seed)
    return random.normal(size=order) * np.tile([0.01, 0.01, 0.5], order // 3)


def difference(function: object, q: Array) -> Array:
    return np.stack(
        [
            (function(q + STEP * e) - function(q - STEP * e)) / (2.0 * STEP)  # type: ignore[operator]
            for e in np.eye(q.size)
        ],
        axis=-1,
    )


@pytest.mark.parametrize(
    "source",
    [chain(4), parallelogram(coupling=211.0)],
)
def test_force_is_the_gradient_and_tangent_the_hessian(source: Mechanism) -> None:
    model = nonlinear(source)
    q = state(model.order)
    force, tangent = model.force(q), model.tangent(q)
    slope = difference(model.potential_energy, q)
    assert np.abs(slope - force).max() <= DIFFERENCE * np.abs(force).max()
    bend = difference(model.force, q)
    assert np.abs(bend - tangent).max() <= DIFFERENCE * np.abs(tangent).max()


def test_elongation_has_exact_derivatives() -> None:
    model = nonlinear(chain(4))
    q = state(model.order)
    _, gradient, hessian = model.elongation("push", q)
    slope = difference(lambda z: model.elongation("push", z)[0], q)
    bend = difference(lambda z: model.elongation("push", z)[1], q)
    assert np.abs(slope - gradient).max() <= DIFFERENCE
    assert np.abs(bend - hessian).max() <= DIFFERENCE
    assert np.abs(hessian).max() > 0.01


@pytest.mark.parametrize("name", ["vgtu-piezo", "vgtu-mechanical"])
def test_tangent_at_rest_is_the_linear_stiffness(name: str) -> None:
    stage = design(name)
    system = lumped_system(stage)
    model = nonlinear(mechanism(stage))
    scale = np.sqrt(np.outer(np.diag(system.K), np.diag(system.K)))
    assert np.all(np.abs(model.tangent(np.zeros(model.order)) - system.K) <= 1e-12 * scale)
    assert np.allclose(model.mass, np.diag(system.M), rtol=1e-13, atol=0.0)
    # drives and probes: their gradient at rest is the vector of the linear model
    for drive in system.drives:
        _, gradient, _ = model.elongation(drive.name, np.zeros(model.order))
        assert np.allclose(gradient, drive.vector, rtol=0.0, atol=1e-14)


def test_small_displacement_is_the_linear_solution() -> None:
    stage = design("vgtu-piezo")
    drive = stage.axis("x").drive
    push = 1e-9
    linear = static_displacements(lumped_system(stage), {drive: push})
    model = nonlinear(mechanism(stage))
    found = equilibrium(model, {drive: push})
    # the quadratic terms are push over a lever arm of millimetres: 1e-7 to 1e-6
    assert found.drive_force[drive] == pytest.approx(linear.drive_force[drive], rel=1e-5)
    assert np.abs(found.q - linear.q).max() <= 1e-5 * np.abs(linear.q).max()


@pytest.mark.parametrize("name", ["double-parallelogram", "compound-parallelogram", "gantry"])
def test_loads_of_leaves_may_be_small(name: str) -> None:
    """Leaves are thousands of times stiffer along than across; rounding must not count as load."""
    stage = design(name)
    axis = stage.axis("x")
    linear = static_displacements(lumped_system(stage), {axis.drive: 1e-9})
    force = linear.drive_force[axis.drive]
    model = nonlinear(mechanism(stage))
    path = stroke_path(model, axis.drive, axis.probe, [0.0, 1e-9])
    assert path.drive_force[1] == pytest.approx(force, rel=1e-6)
    for part in (1.0, 1e-3):
        pushed = equilibrium(model, {}, forces={axis.drive: part * force})
        assert np.abs(pushed.q / part - linear.q).max() <= 1e-6 * np.abs(linear.q).max()
    # in the same proportion as a larger one
    time = np.linspace(0.0, 1e-5, 3)
    run = [
        motion(model, time, drive_force={axis.drive: lambda _, f=size: f}).q[-1]
        for size in (1e-6, 1e-2)
    ]
    assert np.abs(run[0] * 1e4 - run[1]).max() <= 1e-6 * np.abs(run[1]).max()


def test_states_of_leaves_come_at_once_or_one_by_one() -> None:
    """Each of a batch converges in a step of its own."""
    model = nonlinear(mechanism(design("gantry")))
    random = np.random.default_rng(0)
    sizes_of_load = np.geomspace(1e-6, 1.0, 51)
    load = random.standard_normal((model.order, 51)) * sizes_of_load
    q = np.linalg.solve(model.tangent(np.zeros(model.order)), load).T
    energy = model.potential_energy(q)
    assert energy == pytest.approx([float(model.potential_energy(x)) for x in q], rel=1e-9)


def test_path_without_displacements_is_empty() -> None:
    for model in (nonlinear(parallelogram()), nonlinear(mechanism(design("double-parallelogram")))):
        drive, probe = model.mechanism.drives[0].name, model.mechanism.probes[0].name
        path = stroke_path(model, drive, probe, [])
        assert path.q.shape == (0, model.order)
        readings = (path.along, path.across, path.rotation, path.drive_force, path.drive_stiffness)
        assert [x.shape for x in (*readings, *path.hinge_stress.values())] == [(0,)] * (
            5 + len(path.hinge_stress)
        )


def test_parallelogram_moves_on_its_arc() -> None:
    # necks that are stiff but for rotation: a four-bar parallelogram of legs LEG. The platform
    # keeps its angle and sinks by LEG - sqrt(LEG^2 - d^2), about d^2/(2 LEG); the force is the
    # slope of 4 k theta^2/2 with sin(theta) = d/LEG. What is left is the compliance of the
    # necks, 1e-8.
    k = 7.3
    model = nonlinear(parallelogram(along=5e12, across=3e12, rotation=k))
    d = np.linspace(-0.003, 0.003, 13)
    path = stroke_path(model, "push", "read", d)
    theta = np.arcsin(d / LEG)
    assert np.allclose(path.along, d, rtol=0.0, atol=1e-15)
    assert np.allclose(path.across, LEG * (np.cos(theta) - 1.0), rtol=0.0, atol=1e-10)
    assert np.allclose(path.drive_force, 4.0 * k * theta / (LEG * np.cos(theta)), rtol=1e-7)
    assert path.parasitic_rotation < 1e-8
    # the bow of a symmetric arc over its least-squares line is its whole height
    assert path.straightness == pytest.approx(0.003**2 / (2.0 * LEG), rel=0.01)


def test_newton_converges_quadratically() -> None:
    # 6 mm in one go on bodies of 30 mm: digits double in each step, so 12 of them take 7; without
    # the second derivatives of the drive's elongation it is 12 steps
    model = nonlinear(chain(4))
    assert equilibrium(model, {"push": 0.006}).iterations <= 8


def test_straight_path_has_no_deviation() -> None:
    path = stroke_path(parallelogram(), "push", "read", [1e-6, 2e-6])
    # two points are always on a line
    assert path.straightness < 1e-20
    assert path.displacement.shape == (2,)
    assert path.q.shape == (2, 9)


def test_path_of_a_stage() -> None:
    stage = design("parallelogram")
    d = np.linspace(0.0, 0.2e-3, 5)
    path = stroke_path(stage, "x", "x", d)
    # necks of a leg are 30 mm apart; compliant necks add to the arc some per cent of it
    assert path.across[-1] == pytest.approx(-(0.2e-3**2) / (2.0 * 0.030), rel=0.05)


def test_free_undamped_run_keeps_its_energy() -> None:
    model = nonlinear(parallelogram())
    start = equilibrium(model, {"push": 0.002}).q
    stiffness = model.tangent(np.zeros(model.order))
    omega = np.sqrt(eigh(stiffness, np.diag(model.mass), eigvals_only=True))
    period = 2.0 * np.pi / omega[0]
    # a tenth of the leg's length: far into the nonlinear range
    run = motion(model, np.arange(12 * 4 + 1) * period / 12, start)
    assert np.abs(run.energy / run.energy[0] - 1.0).max() < 1e-11
    assert run.kinetic_energy.max() > 0.5 * run.energy[0]


@pytest.mark.parametrize("periods", sizes(slow=200, evidence=1000))
def test_energy_over_many_periods(periods: int) -> None:
    model = nonlinear(parallelogram())
    start = equilibrium(model, {"push": 0.001}).q
    stiffness = model.tangent(np.zeros(model.order))
    omega = np.sqrt(eigh(stiffness, np.diag(model.mass), eigvals_only=True))
    period = 2.0 * np.pi / omega[0]
    run = motion(model, np.arange(12 * periods + 1) * period / 12, start, stages=2)
    # 1e-8 in a thousand periods; what is lost steadily is less in fewer
    assert np.abs(run.energy / run.energy[0] - 1.0).max() < 1e-11 * periods
    # it did move: a passage through the middle in each direction in every period
    along = model.reading("read", run.q)[:, 0]
    passages = np.count_nonzero(np.diff(np.sign(along)))
    assert 1.95 * periods < passages < 2.05 * periods


def test_damping_takes_energy_at_the_modal_rate() -> None:
    model = nonlinear(parallelogram())
    stiffness = model.tangent(np.zeros(model.order))
    omega2, shapes = eigh(stiffness, np.diag(model.mass))
    omega = np.sqrt(omega2[0])
    alpha, beta = 3.0, 2e-5
    zeta = 0.5 * (alpha / omega + beta * omega)
    period = 2.0 * np.pi / omega
    # micrometres: the linear law of decay holds to 1e-6
    start = 1e-6 * shapes[:, 0] / np.abs(shapes[:, 0]).max()
    run = motion(model, np.arange(61) * period / 20, start, rayleigh=(alpha, beta))
    decay = np.exp(-zeta * omega * run.time)
    wd = omega * np.sqrt(1.0 - zeta**2)
    wanted = decay * (np.cos(wd * run.time) + zeta * omega / wd * np.sin(wd * run.time))
    got = run.q @ np.diag(model.mass) @ start / (start @ np.diag(model.mass) @ start)
    assert np.abs(got - wanted).max() < 1e-5


@pytest.mark.slow
def test_drive_force_moves_to_the_static_state() -> None:
    model = nonlinear(parallelogram())
    push = 3.0
    run = motion(
        model,
        np.linspace(0.0, 0.1, 201),
        drive_force={"push": lambda _: push},
        rayleigh=(400.0, 0.0),
    )
    still = equilibrium(model, {}, forces={"push": push})
    # modes of the legs, thousandfold stiffer, are not resolved by these steps and ring on
    assert np.abs(run.q[-1] - still.q).max() < 2e-4 * np.abs(still.q).max()
    assert still.drive_force == {}


def test_errors_say_what_is_wrong(monkeypatch: pytest.MonkeyPatch) -> None:
    model = nonlinear(parallelogram())
    with pytest.raises(ModelError, match="no drive 'pull'"):
        equilibrium(model, {"pull": 1e-6})
    with pytest.raises(ModelError, match="no probe 'x'"):
        stroke_path(model, "push", "x", [0.0, 1e-6])
    with pytest.raises(ModelError, match="equally spaced"):
        motion(model, [0.0, 1.0, 3.0])
    monkeypatch.setattr("flexstage.lumped.large_displacement._ITERATIONS", 2)
    with pytest.raises(ConvergenceError, match="within 2 Newton steps for push"):
        equilibrium(model, {"push": 0.002})


def test_leaves_shorten_as_they_bend() -> None:
    """A platform on leaves of length L sags by 0.6 d²/L (S. Awtar, A. H. Slocum, 2007)."""
    guide = parallelogram_guide(ParallelogramParameters(leg=round_leaf(50e-3, 0.4e-3, 0.1e-3)))
    path = stroke_path(guide, "x", "x", np.linspace(0.0, 2.5e-3, 11))
    assert path.across == pytest.approx(-0.6 * path.along**2 / 50e-3, rel=5e-3)
    # in series they take each other's sag, and the blocks between give the rest
    pair = design("compound-parallelogram")
    still = stroke_path(pair, "x", "x", np.linspace(0.0, 1e-3, 11))
    assert np.abs(still.across).max() < 1e-12
