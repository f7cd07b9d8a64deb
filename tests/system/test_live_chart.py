"""A live chart in a browser, fed by the server: what it shows, and how one looks at it."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.live_panel import served_live, values
from tests.panel import Look, browser, until

pytestmark = pytest.mark.slow

#: Times of points, and the least and greatest of the first channel, as the page holds them.
_HELD = """chart => {
  const { points, latest } = chart.live;
  const places = [...Array(points.count).keys()].map(k => points.first + k);
  const of = all => places.map(k => all[k * points.channels]);
  return [places.map(k => points.times[k]), of(points.low), of(points.high), latest.step];
}"""

#: How many pixels of a canvas have the colour of each channel.
_COLOURED = """chart => {
  const canvas = chart.querySelector("canvas");
  const { data } = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
  return chart.live.look.data.slice(0, 4).map(colour => {
    const [r, g, b] = [1, 3, 5].map(k => parseInt(colour.slice(k, k + 2), 16));
    let count = 0;
    for (let k = 0; k < data.length; k += 4)
      count += Math.abs(data[k] - r) + Math.abs(data[k + 1] - g) + Math.abs(data[k + 2] - b) < 40
        && data[k + 3] > 200;
    return count;
  });
}"""

_HIDE = """hidden => {
  Object.defineProperty(document, "hidden", { value: hidden, configurable: true });
  document.dispatchEvent(new Event("visibilitychange"));
}"""


@pytest.fixture
def look(tmp_path: Path) -> Iterator[Look]:
    with browser() as running, served_live(tmp_path, seconds=3600.0) as (address, _):
        page = running.new_page(viewport={"width": 1280, "height": 800})
        seen = Look(page)
        page.goto(address)
        page.get_by_role("link", name="Live").click()
        page.wait_for_function(
            """[...document.querySelectorAll('.live-chart')]
                .filter(chart => chart.live?.latest && chart.live.frames > 5).length === 2"""
        )
        yield seen


def follows(chart: Any) -> None:
    """Wait until newer samples have come than those that are there."""
    newest = chart.evaluate("chart => chart.live.latest.newest")
    until(lambda: chart.evaluate("chart => chart.live.latest.newest") > newest + 0.3)


def shows(chart: Any, mode: str, seconds: float) -> None:
    until(
        lambda: chart.evaluate("c => [c.live.latest.mode, c.live.latest.length]") == [mode, seconds]
    )


def require_true(chart: Any) -> None:
    """Compare what a page holds of the first channel with what was fed into it."""
    times, low, high, step = chart.evaluate(_HELD)
    middle, fed = np.array(times), np.round(np.array(times) * 100.0) / 100.0
    if step == 0.0:
        np.testing.assert_allclose(low, values(fed)[:, 0], rtol=1e-6)
        np.testing.assert_allclose(np.diff(fed), 0.01, atol=1e-6)
        return
    for k in range(1, middle.size - 1, 40):
        first, last = np.ceil(100.0 * (middle[k] + step * np.array([-0.5, 0.5])) + [1e-3, -1.001])
        inside = values(np.arange(first, last + 1) / 100.0)[:, 0]
        # samples on the edge of a bin may lie on either side of it
        assert low[k] == pytest.approx(inside.min(), abs=1.0)
        assert high[k] == pytest.approx(inside.max(), abs=1.0)
        assert low[k] < high[k]


def test_a_live_chart_follows_and_is_looked_at(look: Look) -> None:
    page = look.page
    chart, loop = page.locator(".live-chart").nth(0), page.locator(".live-chart").nth(1)
    follows(chart)
    require_true(chart)
    assert min(chart.evaluate(_COLOURED)) > 300
    assert loop.evaluate(_COLOURED)[2] > 100
    # each window, with what came in the meantime
    for name, seconds in (("1 min", 60), ("10 min", 600), ("1 h", 3600)):
        chart.get_by_role("button", name=name, exact=True).click()
        shows(chart, "time", seconds)
        follows(chart)
        require_true(chart)
        assert chart.evaluate("chart => chart.live.points.count") <= 2000
        assert chart.evaluate("chart => chart.live.latest.continues")
    assert min(chart.evaluate(_COLOURED)) > 2000
    # nobody looks: nothing is asked; then what was missed is there
    page.evaluate(_HIDE, True)
    page.wait_for_timeout(300)
    answers = chart.evaluate("chart => chart.live.answers")
    page.wait_for_timeout(1200)
    assert chart.evaluate("chart => chart.live.answers") == answers
    page.evaluate(_HIDE, False)
    chart.get_by_role("button", name="10 s", exact=True).click()
    follows(chart)
    require_true(chart)
    loop.get_by_role("button", name="Spectrum").click()
    shows(loop, "spectrum", 60)
    page.wait_for_timeout(300)
    assert min(loop.evaluate(_COLOURED)) > 100
    look.require_sound("live")


def test_a_live_chart_is_used_by_keyboard_and_kept(look: Look) -> None:
    page = look.page
    chart, loop = page.locator(".live-chart").nth(0), page.locator(".live-chart").nth(1)
    chart.get_by_role("button", name="10 min").click()
    shows(chart, "time", 600)
    canvas, told = chart.locator("canvas"), chart.get_by_role("status")
    canvas.focus()
    page.keyboard.press("Space")
    assert told.inner_text() == "paused"
    page.keyboard.press("+")
    page.keyboard.press("ArrowLeft")
    until(lambda: chart.evaluate("chart => chart.live.latest.length") == 300)
    require_true(chart)
    # zoomed in so far that every sample is shown
    box = canvas.bounding_box()
    page.mouse.move(box["x"] + 500, box["y"] + 100)
    page.mouse.down()
    page.mouse.move(box["x"] + 530, box["y"] + 120)
    page.mouse.up()
    until(lambda: chart.evaluate("chart => chart.live.latest.step") == 0)
    require_true(chart)
    page.keyboard.press("Shift+ArrowRight")
    assert told.inner_text().startswith("at ")
    assert "x voltage" in told.inner_text()
    page.keyboard.press("Home")
    follows(chart)
    # a hidden channel, another mode and another unit outlive a reload
    chart.get_by_role("button", name="y position").click()
    loop.get_by_role("button", name="Time", exact=True).click()
    page.get_by_role("button", name="Units and theme").click()
    page.get_by_role("combobox", name="Lengths").click()
    page.get_by_role("option", name="nm", exact=True).click()
    page.wait_for_selector("canvas[data-axes*='Position [nm]']")
    page.reload()
    page.wait_for_selector("canvas[data-axes*='Position [nm]']")
    assert chart.get_by_role("button", name="y position").get_attribute("aria-pressed") == "false"
    assert loop.evaluate("chart => chart.live.mode") == "time"
    follows(chart)
    assert chart.evaluate(_COLOURED)[3] == 0
    # an axis without a title would be found
    assert look.unlabelled_axes() == 0
    axes = '[{"axis":"x","title":""},{"axis":"y1","title":"Voltage [V]"}]'
    page.evaluate(
        "document.querySelectorAll('.live-chart').forEach(c => { c.live.isRemoved = true; })"
    )
    page.wait_for_timeout(300)
    canvas.evaluate("(canvas, axes) => { canvas.dataset.axes = axes; }", axes)
    assert look.unlabelled_axes() == 1
    assert not look.complaints
