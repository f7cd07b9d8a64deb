"""The sheet of equations: complete, of readable size, well formed in every form."""

import re
import xml.dom.minidom

import pytest
import sympy as sp

from flexstage.lumped import (
    condense,
    equation_sheet,
    mathml,
    symbolic_model,
    transfer_function,
)
from flexstage.lumped.latex import Formula, SheetSection, latex_document, plain_text, sheet_data
from flexstage.lumped.symbols import upright
from flexstage.stage.designs import design
from tests.mechanisms import damped_parallelogram


@pytest.fixture(scope="module")
def small() -> tuple[SheetSection, ...]:
    made = damped_parallelogram()
    return equation_sheet(made.model, reduced=made.reduced, transfer=[made.transfer])


def test_sections_are_all_there(small: tuple[SheetSection, ...]) -> None:
    keys = [section.key for section in small]
    assert keys == [
        "bodies",
        "kinetic",
        "hinge",
        "hinges",
        "lagrange",
        "matrices",
        "motion",
        "operator",
        "reduced",
        "transfer",
        "values",
    ]


def test_latex_is_balanced(small: tuple[SheetSection, ...]) -> None:
    text = latex_document("A guide & its 100 % equations", small)
    assert text.count(r"\begin{document}") == text.count(r"\end{document}") == 1
    stack: list[str] = []
    for kind, name in re.findall(r"\\(begin|end)\{(\w+\*?)\}", text):
        if kind == "begin":
            stack.append(name)
        else:
            assert stack.pop() == name
    assert not stack
    depth = 0
    for token in re.findall(r"\\.|[{}]", text):
        depth += {"{": 1, "}": -1}.get(token, 0)
        assert depth >= 0
    assert depth == 0
    assert r"A guide \& its 100 \% equations" in text
    # a formula of every kind
    for piece in (r"\frac{\partial T}{\partial \dot{x}}", r"k_{v1}", r"\ddot{\theta}_3", "K_{1,3}"):
        assert piece in text, piece


def test_plain_text_says_the_equation_of_motion(small: tuple[SheetSection, ...]) -> None:
    text = plain_text("A guide", small)
    assert "x_1''*m_1" in text
    assert "d/dt dT/dq_i' - dT/dq_i + dD/dq_i' + dV/dq_i = Q_i" in text
    assert "\\" not in text
    assert "{" not in text


@pytest.mark.slow
def test_study_stage_is_not_megabytes() -> None:
    model = symbolic_model(design("vgtu-piezo"))
    small = condense(model)
    transfer = [transfer_function(small, a, a) for a in ("x", "y")]
    sheet = equation_sheet(model, reduced=small, transfer=transfer)
    text = latex_document("x", sheet)
    assert 20_000 < len(text) < 200_000
    assert len(plain_text("x", sheet)) < 100_000


def test_mathml_is_xml(small: tuple[SheetSection, ...]) -> None:
    found = 0
    for section in sheet_data(small):
        for item in section["items"]:
            if "mathml" in item:
                found += 1
                xml.dom.minidom.parseString(item["mathml"])
    assert found > 30
    text = mathml(sp.Symbol(r"\ddot{\theta}_3") * sp.Symbol(r"k_{v\theta1}"))
    assert "<mover><mi>θ</mi><mo>..</mo></mover>" in text
    assert "<mi>vθ1</mi>" in text


def test_nothing_runs_off_the_page() -> None:
    # 260 characters of LaTeX are what a line of 170 mm holds, measured by typesetting both studies
    model = symbolic_model(design("vgtu-mechanical"))
    text = latex_document("x", equation_sheet(model))
    for line in re.findall(r"\\begin\{align\*\}\n(.*?)\\end\{align\*\}", text, re.DOTALL):
        for row in re.sub(r"\\begin\{matrix\}.*?\\end\{matrix\}", "", line).split("\\\\\n"):
            assert len(row) < 260, row


def test_a_wide_matrix_is_listed_entry_by_entry() -> None:
    a = sp.symbols("a_{long}:9")
    wide = sp.Matrix(2, 2, lambda i, j: sum(a) + i - j if i == j else 0)
    section = SheetSection(key="k", title="t", items=(Formula(left=sp.Symbol("K"), right=wide),))
    text = latex_document("x", (section,))
    assert r"\bigl[K\bigr]_{11} ={}& " in text
    assert r"_{22}" in text
    assert r"_{12}" not in text


def test_names_cannot_be_commands() -> None:
    text = latex_document(r"a\input{secret}~^%", ())
    assert r"\title{a\textbackslash{}input\{secret\}\textasciitilde{}\textasciicircum{}\%}" in text


def test_names_of_ports_are_plain_in_symbols() -> None:
    assert upright(r"a_b_c 5% ${x}^2\y") == r"\mathrm{a\_b\_c 5- --x--2-y}"
