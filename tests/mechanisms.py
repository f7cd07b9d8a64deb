"""Small mechanisms of rigid bodies and springs with awkward numbers, for the tests of `lumped`."""

import functools
import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexstage.export.diagram.graph import Diagram
from flexstage.lumped import (
    Mechanism,
    RigidBody,
    Sight,
    SpringHinge,
    reduce_by_symmetry,
    symbolic_model,
    transfer_function,
)
from flexstage.lumped.reduction import ReducedModel, TransferFunction
from flexstage.lumped.symbolic import SymbolicModel

LEG = 0.0213
DISTANCE = 0.0317


def parallelogram(
    along: float = 5.1e7, across: float = 1.7e7, rotation: float = 7.3, coupling: float = 0.0
) -> Mechanism:
    """A platform on two legs with a neck at either end; symmetric about x = 0."""
    spring = np.array([[along, 0.0, 0.0], [0.0, across, coupling], [0.0, coupling, rotation]])
    necks = ((0, 1, -1.0, 0.0), (0, 2, 1.0, 0.0), (1, 3, -1.0, LEG), (2, 3, 1.0, LEG))
    return Mechanism(
        name="parallelogram",
        bodies=(
            RigidBody(name="frame", mass=0.4, inertia=1e-4, centre=(0.0, -0.01), fixed=True),
            RigidBody(name="left", mass=0.0061, inertia=3.1e-7, centre=(-DISTANCE, 0.48 * LEG)),
            RigidBody(name="right", mass=0.0061, inertia=3.1e-7, centre=(DISTANCE, 0.48 * LEG)),
            RigidBody(name="platform", mass=0.093, inertia=4.7e-5, centre=(0.0, LEG + 0.004)),
        ),
        hinges=tuple(
            SpringHinge(
                name=f"h{i}",
                bodies=(a, b),
                at=(side * DISTANCE, height),
                direction=0.5 * math.pi,
                stiffness=spring,
            )
            for i, (a, b, side, height) in enumerate(necks)
        ),
        drives=(
            Sight(
                name="push",
                bodies=(0, 3),
                points=((-0.05, LEG), (-0.04, LEG)),
                direction=0.0,
                stiffness=2.3e7,
            ),
        ),
        probes=(
            Sight(name="read", bodies=(-1, 3), points=((0.0, LEG), (0.0, LEG)), direction=0.0),
        ),
    )


def response(function: TransferFunction, frequency_hz: float) -> complex:
    """A transfer function on the imaginary axis."""
    above, below = function.coefficients()
    s = 2j * math.pi * frequency_hz
    return complex(np.polyval(above, s) / np.polyval(below, s))


class Derived(NamedTuple):
    """Equations in symbols, and what was made of them."""

    model: SymbolicModel
    reduced: ReducedModel
    transfer: TransferFunction


@functools.cache
def damped_parallelogram() -> Derived:
    """The parallelogram with damping in its hinges, from the force of its drive to its probe."""
    values = {"c_{u1}": 310.0, "c_{v1}": 120.0, r"c_{\theta1}": 2e-4, r"c_{v\theta1}": 0.01}
    model = symbolic_model(parallelogram(coupling=211.0), damping="hinge").with_values(**values)
    reduced = reduce_by_symmetry(model)
    return Derived(model, reduced, transfer_function(reduced, "push", "read"))


def chain(free: int, *, held: bool = True, seed: int = 4) -> Mechanism:
    """Bodies in a row with springs that couple everything, at any angle."""
    random = np.random.default_rng(seed)
    bodies = [
        RigidBody(
            name=f"b{i}",
            mass=random.uniform(0.01, 0.1),
            inertia=random.uniform(1e-6, 1e-5),
            centre=(0.03 * i + random.uniform(-0.01, 0.01), random.uniform(-0.02, 0.02)),
            fixed=held and i == 0,
        )
        for i in range(free + held)
    ]
    hinges = [
        SpringHinge(
            name=f"h{i}",
            bodies=(i, i + 1),
            at=(0.03 * i + 0.015, random.uniform(-0.01, 0.01)),
            direction=random.uniform(-3.0, 3.0),
            stiffness=_spring(random),
        )
        for i in range(len(bodies) - 1)
    ]
    last = len(bodies) - 1
    return Mechanism(
        name="chain",
        bodies=tuple(bodies),
        hinges=tuple(hinges),
        drives=(
            Sight(
                name="push",
                bodies=(1, last),
                points=((0.01, 0.02), (0.05, 0.03)),
                direction=math.atan2(0.01, 0.04),
                stiffness=1.3e6,
            ),
        ),
        probes=(
            Sight(
                name="read", bodies=(1, last), points=((0.11, 0.07), (0.11, 0.07)), direction=0.3
            ),
        ),
    )


def _spring(random: np.random.Generator) -> NDArray[np.float64]:
    root = random.normal(size=(3, 3))
    scale = np.diag([3e3, 2e3, 3.0])
    spring = scale @ (root @ root.T + np.eye(3)) @ scale
    return 0.5 * (spring + spring.T)


def without_drive_chains(diagram: Diagram) -> Diagram:
    """Replace the last of amplifier, hysteresis and creep of each drive by an input."""
    chain = ("amplifier", "hysteresis", "creep")
    kinds = {b.name: b.kind for b in diagram.blocks}
    readers: dict[str, set[str]] = {}
    for line in diagram.lines:
        readers.setdefault(line.source, set()).add(kinds[line.target])
    before = {name for name, read_by in readers.items() if read_by <= set(chain)}
    return replace(
        diagram,
        blocks=tuple(
            replace(b, kind="input") if b.kind in chain else b
            for b in diagram.blocks
            if b.name not in before
        ),
        lines=tuple(x for x in diagram.lines if x.source not in before),
    )
