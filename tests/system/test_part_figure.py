"""The picture of a part: each face is named once, and no name covers another."""

from itertools import combinations

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.text import Annotation
from netgen import occ

from flexstage.fem.part import Part
from flexstage.report.figures.part import _label_positions, draw_part


def test_every_face_is_named_once_and_no_name_covers_another() -> None:
    shape = occ.Box((0, 0, 0), (90, 50, 8))
    for k in range(12):
        x, y = 8.0 + 7.0 * k, 10.0 + 29.0 * (k % 2)
        shape = shape - occ.Cylinder((x, y, -1), occ.Z, 1.0 + 0.1 * k, 10)
    inside = occ.Box((30, 20, 3), (36, 27, 5))  # a hollow that is seen from nowhere
    part = Part.from_shape((shape - inside).solids[0])
    figure = draw_part(part, fixed=part.select("x", "min"), moved=part.select("x", "max"))
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    names = {f.name for f in part.faces}
    hidden = {f.name for f in part.faces if 0.029 < f.centre[0] < 0.037 and f.kind == "plane"}
    hidden = {n for n in hidden if next(f for f in part.faces if f.name == n).area < 60e-6}
    shown: list[str] = []
    for axes in figure.axes:
        texts = [t for t in axes.texts if not isinstance(t, Annotation) and t.get_text() in names]
        shown += [t.get_text() for t in texts]
        boxes = [t.get_window_extent(canvas.get_renderer()) for t in texts]
        assert not any(a.overlaps(b) for a, b in combinations(boxes, 2))
        for box in boxes:
            assert figure.bbox.containsx(box.x0)
            assert figure.bbox.containsx(box.x1)
    assert len(hidden) == 6
    assert sorted(shown) == sorted(names - hidden)
    caption = figure.get_supxlabel()
    assert "hidden in all views: " in caption
    assert all(name in caption.split("hidden in all views: ")[1] for name in hidden)


@pytest.mark.parametrize(
    ("wanted", "placed"),
    [
        ([], []),
        ([2.0, 5.0, 8.0], [2.0, 5.0, 8.0]),
        ([5.0, 5.0, 5.0], [4.0, 5.0, 6.0]),
        ([0.1, 0.2, 9.8], [0.5, 1.5, 9.5]),
    ],
)
def test_names_in_a_column_keep_apart(wanted: list[float], placed: list[float]) -> None:
    assert _label_positions(wanted, 1.0, (0.0, 10.0)) == pytest.approx(np.array(placed))
