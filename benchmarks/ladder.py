"""Mechanisms of any number of bodies, for how time grows."""

import math

import numpy as np

from flexstage.lumped import Mechanism, RigidBody, Sight, SpringHinge

__all__ = ["ladder"]


def ladder(count: int) -> Mechanism:
    """A row of `count` bodies, the first one held; every third hangs on it as well."""
    spring = np.array([[1.6e8, 0.0, 0.0], [0.0, 2.9e7, 310.0], [0.0, 310.0, 11.3]])
    bodies = [
        RigidBody(
            name=f"b{i}",
            mass=0.01 + 0.002 * (i % 7),
            inertia=1e-6 * (1 + i % 5),
            centre=(0.021 * i, 0.004 * math.sin(1.7 * i)),
            fixed=i == 0,
        )
        for i in range(count)
    ]
    pairs = [(i, i + 1) for i in range(count - 1)] + [(0, i) for i in range(3, count, 3)]
    hinges = tuple(
        SpringHinge(
            name=f"h{k}",
            bodies=(a, b),
            at=(0.021 * b - 0.009, 0.003 * math.cos(k)),
            direction=0.5 * math.pi * (k % 2),
            stiffness=spring * (1.0 + 0.1 * (k % 4)),
        )
        for k, (a, b) in enumerate(pairs)
    )
    end = bodies[-1].centre
    return Mechanism(
        name=f"ladder of {count}",
        bodies=tuple(bodies),
        hinges=hinges,
        drives=(
            Sight(name="push", bodies=(0, 1), points=((0.0, 0.0), (0.021, 0.0)), direction=0.0),
        ),
        probes=(Sight(name="read", bodies=(-1, count - 1), points=(end, end), direction=0.5),),
    )
