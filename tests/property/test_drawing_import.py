"""Any guide, anywhere, with any notch comes back from its drawing."""

import tempfile
from pathlib import Path
from typing import Any

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from flexstage.hinges import (
    AsDrawn,
    CornerFilleted,
    Elliptical,
    Hyperbolic,
    Leaf,
    Parabolic,
    PowerFunction,
    Profile,
    RightCircular,
    VFillet,
)
from flexstage.stage.drawing.drawn_stage import read_drawing
from flexstage.stage.drawing.requests import DrawingOptions
from tests.drawing_stages import guide
from tests.drawn_stages import dxf_without_hinges, require_same

turns = st.floats(-4.0, 4.0)
shifts = st.tuples(st.floats(-0.3, 0.3), st.floats(-0.3, 0.3))


@st.composite
def notches(draw: st.DrawFn) -> Profile:
    """Notches as they are cut: their bodies are at least twice as thick as the neck."""
    neck = draw(st.floats(0.2e-3, 1.5e-3))
    half, depth = draw(st.floats(1.2e-3, 6e-3)), draw(st.floats(1.6e-3, 5e-3))
    common: dict[str, Any] = {"neck_thickness": neck, "one_sided": draw(st.booleans())}
    curved = {**common, "half_length": half, "notch_depth": depth}
    kind = draw(st.sampled_from(("circular", "filleted", "leaf", "v", "smooth", "as-drawn")))
    if kind == "circular":
        return RightCircular(**common, radius=depth)
    if kind == "filleted":
        return CornerFilleted(**common, notch_length=2.0 * (depth + half), fillet_radius=depth)
    if kind == "leaf":
        return Leaf(**common, leaf_length=2.0 * half, notch_depth=depth)
    if kind == "v":
        return VFillet(
            **common,
            half_opening_angle=draw(st.floats(0.35, 1.1)),
            fillet_radius=draw(st.floats(0.3e-3, 1.2e-3)),
            notch_depth=depth,
        )
    if kind == "as-drawn":
        return AsDrawn(
            **common,
            distances=(0.4 * half, 0.7 * half, half),
            depths=(0.0, 0.25 * depth, depth),
            bulges=(0.0, draw(st.floats(0.02, 0.1)), 0.0),
        )
    smooth = draw(st.sampled_from((Elliptical, Parabolic, Hyperbolic, PowerFunction)))
    if smooth is PowerFunction:
        return PowerFunction(**curved, exponent=draw(st.floats(2.5, 6.0)))
    return smooth(**curved)


def _comes_back(profile: Profile, turn: float, shift: tuple[float, float]) -> None:
    stage = guide(profile, turn, shift)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "part.dxf"
        dxf_without_hinges(stage).saveas(path)
        drawn = read_drawing(path, DrawingOptions(thickness=stage.thickness))
    smooth = isinstance(profile, (Elliptical, Parabolic, Hyperbolic, PowerFunction))
    # smooth ones are drawn within 10 nm, and their sizes known a few times worse than that
    require_same(drawn.stage, stage, within=0.1e-6 if smooth else 2e-9)


# a straight flank that ends a quarter of a micrometre beside a round figure
_LONG = VFillet(
    neck_thickness=1.5e-3, half_opening_angle=1.0, fillet_radius=0.3e-3, notch_depth=3.90625e-3
)
# a notch that is steep where it ends, so that the edge there turns by 35 degrees only
_STEEP = Hyperbolic(
    neck_thickness=0.5960603271350625e-3,
    half_length=2.058792757890726e-3,
    notch_depth=2.89143271778517e-3,
    one_sided=True,
)
# a bottom so flat that its middle is drawn as a line, three times as long as the arc beside it
_FLAT = PowerFunction(
    neck_thickness=1.5e-3,
    half_length=3.490625412562445e-3,
    notch_depth=4e-3,
    exponent=5.610183600488207,
    one_sided=True,
)


@settings(max_examples=3, deadline=None)
@given(notches(), turns, shifts)
@example(_LONG, 0.0, (0.0, 0.0))
@example(_STEEP, 2.983444411093359, (0.0, 0.0))
@example(_FLAT, 2.0242468510868488, (0.0, 0.0))
def test_some_guides_come_back(profile, turn, shift) -> None:
    _comes_back(profile, turn, shift)


@pytest.mark.slow
@settings(max_examples=15, deadline=None)
@given(notches(), turns, shifts)
def test_many_guides_come_back(profile, turn, shift) -> None:
    _comes_back(profile, turn, shift)
