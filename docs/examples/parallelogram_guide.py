r"""A parallelogram guide: what it does by hand, and what the lumped model adds.

A platform stands on two parallel legs with a neck at both ends. If bodies are rigid and necks only
turn, a displacement x turns each of the four necks by theta = arcsin(x/L), with L the distance of
the necks of a leg. Hence, with the rotational stiffness k_t of a neck,

    V = 4 k_t theta^2 / 2          ->  k = 4 k_t / L^2 at the platform,
    T = (m_p/2 + 2 (m_l/8 + J_l/(2 L^2))) x'^2
                                   ->  f = sqrt(k/m) / (2 pi),  m = m_p + 2 (m_l/4 + J_l/L^2),
    y = -(L - sqrt(L^2 - x^2))     ->  the platform sinks by about x^2/(2 L),

because the middle of a leg moves half as far as the platform. The lumped model has the axial and
the shear stiffness of the necks as well, and the platform turns a little with their stretch.
"""

import math

import numpy as np

from flexstage.lumped import hinge_springs, lumped_system, stroke_path
from flexstage.stage import mass_properties
from flexstage.stage.designs import design
from flexstage.system import modes, probe_stiffness


def main() -> dict[str, float]:
    """Compare and return the figures."""
    stage = design("parallelogram")
    length = math.dist(stage.hinge("left-lower").at, stage.hinge("left-upper").at)
    rotation = 1.0 / np.linalg.inv(hinge_springs(stage)[0].stiffness)[2, 2]
    bodies = mass_properties(stage)
    leg, platform = bodies["left-leg"], bodies["platform"]
    k = 4.0 * rotation / length**2
    m = platform.mass + 2.0 * (leg.mass / 4.0 + leg.inertia / length**2)

    system = lumped_system(stage)
    x = 0.2e-3
    path = stroke_path(stage, "x", "x", np.linspace(0.0, x, 5))
    figures = {
        "stiffness by hand [N/m]": k,
        "stiffness, lumped [N/m]": probe_stiffness(system, "x"),
        "frequency by hand [Hz]": math.sqrt(k / m) / (2.0 * math.pi),
        "frequency, lumped [Hz]": float(modes(system).frequency_hz[0]),
        "sinking by hand [um]": (length - math.sqrt(length**2 - x**2)) * 1e6,
        "sinking, finite rotations [um]": -float(path.across[-1]) * 1e6,
    }
    for name, value in figures.items():
        print(f"{name:32s} {value:12.6g}")
    return figures


if __name__ == "__main__":
    main()
