"""Sections of a report from plain data: whatever a room hands over is shown, and is no HTML."""

import inspect
import re
from functools import partial
from importlib import import_module

import numpy as np
import pytest
from matplotlib.figure import Figure

from flexstage.base.errors import ModelError
from flexstage.quantities.table import (
    Bullets,
    Cell,
    Column,
    Definitions,
    Picture,
    Pictures,
    Section,
    Table,
    table,
)
from flexstage.records import Channel, Record
from flexstage.report.figures.identification import draw_record
from flexstage.report.figures.style import new_figure
from flexstage.report.page import DRAWINGS, page_html, sections_html

ODD = "<b>a & \"b\"</b> 'c' -5 {{ 7 * 7 }} $x^{"
SHOWN = "&lt;b&gt;a &amp; &#34;b&#34;&lt;/b&gt; &#39;c&#39; −5 {{ 7 * 7 }} $x^{"


def plot() -> Figure:
    figure = new_figure(3.0, 2.0)
    figure.subplots()
    return figure


def picture(title: str = "a plot") -> Picture:
    return Picture(result=partial(plot), title=title, caption=f"{title}.")


def test_every_kind_of_content_is_shown_in_its_order() -> None:
    inner = Section(title="Inside", content=("words",))
    rows = table("What is.", ("axis", "stroke [µm]"), [("x", 64)], notes=("once",))
    section = Section(
        title="A test",
        key="test",
        notes=("beforehand",),
        content=(
            "first",
            rows,
            picture(),
            Pictures(pictures=(picture("left"), picture("right")), columns=2),
            Bullets(("one", "two")),
            Definitions({"name": "value"}),
            inner,
        ),
    )
    text = sections_html(section)
    places = [
        text.index(word)
        for word in (
            '<section id="test"><h2>A test</h2>',
            '<div class="note"><p>beforehand</p></div>',
            "<p>first</p>",
            "<caption><b>Table 1.</b> What is.</caption>",
            '<td class="text">x</td><td>64</td>',
            "<li>once</li>",
            "<b>Figure 1.</b> a plot.",
            '<div class="plots two">',
            "<b>Figure 2.</b> left.",
            "<b>Figure 3.</b> right.",
            "<li>two</li>",
            "<dt>name</dt><dd>value</dd>",
            "<h3>Inside</h3>",
            "<p>words</p>",
        )
    ]
    assert places == sorted(places)
    ids = re.findall(r'\bid="([^"]+)"', text)
    assert len(ids) == len(set(ids))


def test_any_record_is_drawn_channels_of_one_unit_together() -> None:
    time = np.linspace(0.0, 2.0, 41)
    channels = (
        Channel(name="u", values=3.0 + 50.0 * time, unit="V"),
        Channel(name="x", values=2e-6 * time**2, unit="m"),
        Channel(name="y$x^{", values=-7e-6 * time, unit="m"),
    )
    record = Record(channels=channels, time=time)
    shown = Picture(result=record, title="a record", caption="A record.", options={"title": "raw"})
    text = sections_html(Section(title="", key="r", content=(shown,)))
    for word in (">u [V]<", ">[µm]<", ">x<", ">y$x^{<", ">time [s]<", ">raw<"):
        assert word in text
    upper, lower = draw_record(record).axes
    (line,) = upper.lines
    assert np.array_equal(line.get_xydata(), np.column_stack((time, channels[0].values)))
    assert [line.get_label() for line in lower.lines] == ["x", "y$x^{"]
    assert np.ravel(lower.lines[1].get_ydata())[-1] == pytest.approx(-14.0)


def test_every_drawing_is_there_and_takes_its_result() -> None:
    for function, parameters in DRAWINGS.values():
        module, _, name = function.partition(".")
        draw = getattr(import_module(f"flexstage.report.figures.{module}"), name)
        named = {parameter.partition("=")[0] for parameter in parameters.split()}
        assert named <= inspect.signature(draw).parameters.keys(), function


def test_words_are_words() -> None:
    made = table(ODD, (ODD, Column(ODD, group=ODD)), [(Cell(ODD, small=ODD), ODD)], notes=(ODD,))
    content = (ODD, made, Bullets((ODD,)), Definitions({ODD: ODD}), picture(ODD))
    text = page_html(
        heading=ODD,
        lead=ODD,
        version="1",
        sections=(Section(title=ODD, key="k", content=content, notes=(ODD,)),),
        notes=(ODD, "other"),
    )
    assert "<b>a" not in text
    assert "49" not in re.sub(r"<(style|script)>.*?</\1>", "", text, flags=re.S)
    assert text.count(SHOWN) >= 14


def test_a_table_has_groups_and_sets_its_subjects_apart() -> None:
    columns = (
        Column("q", "title"),
        Column("a", group="both"),
        Column("b", group="both"),
        Column("c"),
    )
    rows = [("one", 1, 2, 3), ("one", 4, 5, 6), ("two", Cell("7", mark="ours", note="why"), 8, 9)]
    made = table("", columns, rows, divided=True)
    assert made.groups == (("", 1), ("both", 2), ("", 1))
    assert made.divisions == (True, False, True)
    text = sections_html(Section(title="", key="t", content=(made,)))
    assert '<th colspan="2">both</th>' in text
    assert '<tr class="next"><th class="text">two</th><td class="ours" title="why">7</td>' in text
    assert "<caption>" not in text


def test_a_row_of_another_length_is_refused() -> None:
    with pytest.raises(ModelError, match="a row of the table 'short' has 1 cells, expected 2"):
        Table(caption="short", columns=(Column("a"), Column("b")), rows=((Cell("1"),),))


def test_a_result_that_nothing_draws_is_refused() -> None:
    for view in ("", "upside down"):
        shown = Picture(result=object(), view=view, title="t", caption="c")
        with pytest.raises(ModelError, match=r"a object cannot be drawn.*there are drawings of"):
            sections_html(Section(title="", key="s", content=(shown,)))


def test_what_a_template_lacks_is_an_error_and_no_gap() -> None:
    from jinja2 import UndefinedError

    with pytest.raises(UndefinedError):
        page_html(heading="h", lead="l", version="1", template="study.html")
