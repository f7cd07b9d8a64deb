"""Lines in a grid of any cells keep off the cells, and arrive."""

from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from flexstage.export.diagram.grid import route
from flexstage.export.diagram.shapes import DiagramCell, Net, Pin, Routed, branches


@st.composite
def grids(
    draw: st.DrawFn,
) -> tuple[dict[str, DiagramCell], dict[str, tuple[int, int]], dict[str, Net]]:
    """Draw cells of uneven sizes, some drawn from right to left, and lines between their pins."""
    count = draw(st.integers(2, 9))
    spots = draw(
        st.lists(
            st.tuples(st.integers(0, 3), st.integers(0, 3)),
            min_size=count, max_size=count, unique=True,
        )
    )  # fmt: skip
    cells, places, free = {}, {}, []
    for k, spot in enumerate(spots):
        inputs = draw(st.integers(1, 3))
        flipped = draw(st.booleans())
        into, out = ("R", "L") if flipped else ("L", "R")
        height = 20.0 * inputs + draw(st.integers(0, 3)) * 7.0
        pins = {f"in{i}": Pin(into, 10.0 + 20.0 * i) for i in range(inputs)}
        pins["out"] = Pin(out, 0.5 * height)
        name = f"c{k}"
        cells[name] = DiagramCell(
            width=30.0 + draw(st.integers(0, 4)) * 11.0, height=height, axis=0.5 * height, pins=pins
        )
        places[name] = spot
        free += [(name, f"in{i}") for i in range(inputs)]
    targets: dict[str, list[tuple[str, str]]] = {}
    for end in draw(st.lists(st.sampled_from(free), min_size=1, unique=True)):
        targets.setdefault(draw(st.sampled_from(list(cells))), []).append(end)
    nets = {n: Net(source=(n, "out"), targets=tuple(t)) for n, t in targets.items()}
    return cells, places, nets


@settings(deadline=None, max_examples=120, suppress_health_check=[HealthCheck.too_slow])
@given(case=grids(), apart=st.booleans())
def test_lines_keep_off_cells_and_arrive(
    case: tuple[dict[str, DiagramCell], dict[str, tuple[int, int]], dict[str, Net]], apart: bool
) -> None:
    cells, places, nets = case
    done = route(cells, places, nets, apart=apart)
    for segments in done.lines.values():
        for (x1, y1), (x2, y2) in segments:
            assert x1 == x2 or y1 == y2
            assert -1e-9 <= x1 <= x2 <= done.size[0] + 1e-9
            assert -1e-9 <= y1 <= y2 <= done.size[1] + 1e-9
            for name, (x, y) in done.cells.items():
                right, low = x + cells[name].width, y + cells[name].height
                outside = x2 <= x + 0.1 or x1 >= right - 0.1 or y2 <= y + 0.1 or y1 >= low - 0.1
                assert outside, (name, (x1, y1), (x2, y2))
    for name, net in nets.items():
        assert arrives(done, cells, net, name)
        for point in branches(done.lines[name]):
            assert 0.0 <= point[0] <= done.size[0]


def arrives(done: Routed, cells: dict[str, DiagramCell], net: Net, name: str) -> bool:
    """Whether all pins of a line hang together by its segments."""

    def pin(end: tuple[str, str]) -> tuple[float, float]:
        (x, y), cell = done.cells[end[0]], cells[end[0]]
        found = cell.pins[end[1]]
        return (x + (cell.width if found.side == "R" else 0.0), y + found.y)

    def on(s: tuple[tuple[float, float], tuple[float, float]], p: tuple[float, float]) -> bool:
        (x1, y1), (x2, y2) = s
        return x1 - 1e-6 <= p[0] <= x2 + 1e-6 and y1 - 1e-6 <= p[1] <= y2 + 1e-6

    def meet(a: tuple[tuple[float, float], ...], b: tuple[tuple[float, float], ...]) -> bool:
        (ax1, ay1), (ax2, ay2) = a
        (bx1, by1), (bx2, by2) = b
        return min(ax2, bx2) - max(ax1, bx1) >= -1e-6 and min(ay2, by2) - max(ay1, by1) >= -1e-6

    segments = list(done.lines[name])
    reached = [s for s in segments if on(s, pin(net.source))]
    for s in reached:
        reached += [t for t in segments if t not in reached and meet(s, t)]
    return all(any(on(s, pin(t)) for s in reached) for t in net.targets)
