r"""The time integration reaches the order that its theory promises.

Evidence (Stages, tolerances, designs): momentum of a driven free chain: $2\cdot10^{-15}$; order of
time integration (twice its stages): 0.35
"""

import numpy as np
import pytest

from flexstage.lumped import RigidBody, Sight, SpringHinge, motion, nonlinear
from flexstage.lumped.rigid_bodies import Mechanism
from tests.mechanisms import chain


def pendulum() -> Mechanism:
    """One body on one soft hinge: all three frequencies within a factor of some ten."""
    spring = np.array([[310.0, 17.0, 0.0], [17.0, 170.0, 0.3], [0.0, 0.3, 0.021]])
    return Mechanism(
        name="pendulum",
        bodies=(
            RigidBody(name="frame", mass=1.0, inertia=1.0, centre=(0.0, 0.0), fixed=True),
            RigidBody(name="bob", mass=0.11, inertia=2.3e-5, centre=(0.031, 0.012)),
        ),
        hinges=(
            SpringHinge(
                name="h", bodies=(0, 1), at=(0.004, -0.003), direction=0.4, stiffness=spring
            ),
        ),
        drives=(
            Sight(name="push", bodies=(0, 1), points=((0.0, 0.0), (0.03, 0.0)), direction=0.0),
        ),
    )


@pytest.mark.parametrize(
    "stages", [pytest.param(1, marks=pytest.mark.slow), 2, pytest.param(3, marks=pytest.mark.slow)]
)
def test_order_is_twice_the_stages(stages: int) -> None:
    model = nonlinear(pendulum())
    start = np.array([0.002, -0.001, 0.3])
    end = 0.05

    def error(count: int) -> float:
        run = motion(
            model,
            np.linspace(0.0, end, count + 1),
            start,
            drive_force={"push": lambda t: 0.3 * np.sin(70.0 * t)},
            rayleigh=(2.0, 1e-4),
            stages=stages,
        )
        return float(np.abs((run.q[-1] - exact) * [10.0, 10.0, 1.0]).max())

    exact = motion(
        model,
        np.linspace(0.0, end, 201),
        start,
        drive_force={"push": lambda t: 0.3 * np.sin(70.0 * t)},
        rayleigh=(2.0, 1e-4),
        stages=5,
    ).q[-1]
    coarse, fine = {1: (40, 80), 2: (20, 40), 3: (15, 30)}[stages]
    order = np.log2(error(coarse) / error(fine))
    # the leading term of the error dominates to within a fifth of an order at these steps
    assert order == pytest.approx(2.0 * stages, abs=0.35)


def momenta(source: Mechanism, step: float) -> tuple[np.ndarray, np.ndarray]:
    """Linear and angular momentum of a free chain that is thrown, with a drive at work inside."""
    model = nonlinear(source)
    random = np.random.default_rng(3)
    run = motion(
        model,
        np.arange(0.0, 0.0101, step),
        None,
        random.normal(size=model.order) * np.tile([0.05, 0.05, 3.0], 4),
        drive_force={"push": lambda t: 0.5 * np.sin(3e3 * t)},
    )
    mass, inertia = model.mass[0::3], model.mass[2::3]
    q, v = (a.reshape(run.time.size, -1, 3) for a in (run.q, run.velocity))
    x, y = (q[..., k] + [source.bodies[i].centre[k] for i in source.free] for k in (0, 1))
    linear = np.einsum("b,tbk->tk", mass, v[..., :2])
    spin = v[..., 2] @ inertia
    return linear, spin + (x * v[..., 1] - y * v[..., 0]) @ mass


@pytest.mark.slow
def test_what_is_free_keeps_its_momenta() -> None:
    source = chain(4, held=False)
    linear, coarse = momenta(source, 1e-4)
    _, fine = momenta(source, 5e-5)
    assert np.abs(linear - linear[0]).max() < 1e-13 * np.abs(linear).max()
    # angular momentum is kept to the order of the method, 6: halving the step gains 64 or more
    lost, less = (np.abs(a - a[0]).max() / np.abs(a).max() for a in (coarse, fine))
    assert less < 1e-6
    assert lost / less > 50.0
