"""A notch as drawn is, where it has the contour of one with a name, that notch in every figure."""

import dataclasses
import math

import numpy as np
import pytest

from flexstage.base.errors import HingeError
from flexstage.hinges import (
    AsDrawn,
    CornerFilleted,
    Leaf,
    Profile,
    RightCircular,
    VFillet,
    compliance,
    concentration,
)
from flexstage.hinges.registry import with_neck_thickness

NAMED: dict[str, Profile] = {
    "circular": RightCircular(neck_thickness=0.53e-3, radius=1.3e-3),
    "circular-one-sided": RightCircular(neck_thickness=0.53e-3, radius=1.3e-3, one_sided=True),
    "corner-filleted": CornerFilleted(
        neck_thickness=0.41e-3, notch_length=5.3e-3, fillet_radius=0.9e-3
    ),
    "leaf": Leaf(neck_thickness=0.37e-3, leaf_length=6.1e-3, notch_depth=1.3e-3),
    "v": VFillet(
        neck_thickness=0.61e-3, half_opening_angle=0.6, fillet_radius=0.7e-3, notch_depth=1.9e-3
    ),
}


def drawn(profile: Profile) -> AsDrawn:
    """The contour of a profile, without its name."""
    corners = profile.contour()
    return AsDrawn(
        neck_thickness=profile.neck_thickness,
        one_sided=profile.one_sided,
        distances=tuple(v.x for v in corners[1:]),
        depths=tuple(v.depth for v in corners[1:]),
        bulges=tuple(v.bulge for v in corners[:-1]),
    )


@pytest.mark.parametrize("name", NAMED)
def test_it_is_the_notch_whose_contour_it_has(name: str) -> None:
    meant = NAMED[name]
    found = drawn(meant)
    for size in ("length", "depth", "flat_length", "step", "root_height", "neck_radius"):
        assert getattr(found, size) == pytest.approx(getattr(meant, size), rel=1e-12, abs=1e-15)
    assert found.half_area_integrals() == pytest.approx(meant.half_area_integrals(), rel=1e-12)
    for method in ("euler-bernoulli", "timoshenko", "wedge", "finite-element"):
        a, b = (
            compliance(p, 71.7e9, 0.33, 9e-3, method=method, root_widths=(9e-3, 12e-3)).matrix
            for p in (found, meant)
        )
        np.testing.assert_allclose(a, b, rtol=1e-9, atol=1e-12 * np.max(np.abs(b)))
    a, b = concentration(found), concentration(meant)
    assert (*a.axial, *a.bending) == pytest.approx((*b.axial, *b.bending), rel=1e-12)


def test_a_sharp_tip_has_no_finite_stress() -> None:
    notch = AsDrawn(neck_thickness=0.5e-3, distances=(1e-3,), depths=(1.5e-3,))
    assert notch.neck_radius == 0.0
    assert "infinite" in concentration(notch).source


def test_another_neck_leaves_roots_and_length() -> None:
    notch = drawn(NAMED["corner-filleted"])
    changed = with_neck_thickness(notch, 0.44e-3)
    assert changed.neck_thickness == 0.44e-3
    assert changed.length == pytest.approx(notch.length, rel=1e-12)
    assert changed.root_height == pytest.approx(notch.root_height, rel=1e-12)
    # an arc that is stretched is a quarter of an ellipse: the area under it, in closed form
    area, *_ = changed.half_area_integrals()
    r, b = 0.9e-3, changed.depth
    curved = r * b * (1.0 - math.pi / 4.0)
    assert area == pytest.approx(0.44e-3 * 0.5 * changed.length + 2.0 * curved, rel=1e-5)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"depths": (0.0, 1e-3)}, "as many depths"),
        ({"depths": (0.0, -1e-3, 1e-3)}, "it turns back"),
        ({"distances": (2e-3, 1e-3, 3e-3)}, "it turns back"),
        ({"bulges": (0.0, math.inf, 0.0)}, "not finite"),
        ({"bulges": (0.0, 0.9, 0.0)}, "it turns back"),
        ({"depths": (0.0, 0.0, 0.0)}, "get deeper"),
    ],
)
def test_a_contour_that_is_none_is_refused(change: dict, said: str) -> None:
    notch = AsDrawn(
        neck_thickness=0.5e-3,
        distances=(1e-3, 2e-3, 3e-3),
        depths=(0.0, 0.5e-3, 1e-3),
        bulges=(0.0, 0.1, 0.0),
    )
    with pytest.raises(HingeError, match=said):
        dataclasses.replace(notch, **change)
