"""A notch out of its plane: closed forms of beams and of torsion.

Evidence (Hinges): notch out of plane (torsion table): printed digits; (beams): $10^{-8}$
"""

import math

import numpy as np
import pytest
from scipy.integrate import quad

from flexstage.hinges import Leaf, RightCircular
from flexstage.hinges.compliance import out_of_plane_compliance, torsion_constant

E, NU, B = 117.3e9, 0.341, 7e-3
G = E / (2.0 * (1.0 + NU))


@pytest.mark.parametrize(
    ("ratio", "k1"),
    # S. P. Timoshenko, J. N. Goodier, Theory of Elasticity, 1970, section 109: M = k1 G theta a^3 b
    [(1.0, 0.1406), (1.2, 0.166), (1.5, 0.196), (2.0, 0.229), (2.5, 0.249), (3.0, 0.263),
     (4.0, 0.281), (5.0, 0.291), (10.0, 0.312)],
)  # fmt: skip
def test_torsion_of_rectangles_is_that_of_the_table(ratio: float, k1: float) -> None:
    a = np.array(0.7e-3)
    found = torsion_constant(ratio * a, a) / (a**4 * ratio)
    assert float(found) == pytest.approx(k1, abs=6e-4)  # printed with three digits
    assert float(torsion_constant(a, ratio * a)) == float(torsion_constant(ratio * a, a))


def test_a_leaf_is_a_beam() -> None:
    t, length = 0.43e-3, 9e-3
    w, twist, tilt = out_of_plane_compliance(
        Leaf(neck_thickness=t, leaf_length=length, notch_depth=1e-3), E, NU, B
    )
    # between its ends that do not turn: L^3/(12 E I), and shear of 6/5
    assert w == pytest.approx(length**3 / (E * t * B**3) + 1.2 * length / (G * t * B), rel=1e-9)
    assert tilt == pytest.approx(12.0 * length / (E * t * B**3), rel=1e-9)
    # a thin strip: J = b t^3 (1 - 0.630 t/b)/3
    assert twist == pytest.approx(length / (G * B * t**3 / 3.0 * (1.0 - 0.6302 * t / B)), rel=1e-4)


def test_a_circular_notch_is_the_integral_along_its_contour() -> None:
    t, r = 0.47e-3, 1.3e-3

    def height(x: float) -> float:
        return t + 2.0 * (r - math.sqrt(r**2 - x**2))

    w, twist, tilt = out_of_plane_compliance(RightCircular(neck_thickness=t, radius=r), E, NU, B)
    twice = {
        "w": lambda a: (
            (r * math.sin(a)) ** 2 * 12.0 / (E * height(r * math.sin(a)) * B**3)
            + 1.2 / (G * height(r * math.sin(a)) * B)
        ),
        "tilt": lambda a: 12.0 / (E * height(r * math.sin(a)) * B**3),
        "twist": lambda a: (
            1.0 / (G * float(torsion_constant(np.array(height(r * math.sin(a))), np.array(B))))
        ),
    }
    whole = {
        name: 2.0 * quad(lambda a, f=f: f(a) * r * math.cos(a), 0.0, 0.5 * math.pi)[0]
        for name, f in twice.items()
    }
    assert (w, twist, tilt) == pytest.approx((whole["w"], whole["twist"], whole["tilt"]), rel=1e-8)
