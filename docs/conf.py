"""The manual: Sphinx with MyST, and a page for the API of every subpackage."""

import dataclasses
import importlib.util
import inspect
import sys
from pathlib import Path
from typing import Any

from docutils.nodes import SkipNode
from latex2mathml.converter import convert

import flexstage

sys.path.insert(0, str(Path(__file__).parents[1]))
from tests import evidence_table

project = "flexstage"
author = "The flexstage developers"
copyright = "2026, The flexstage developers"
version = release = flexstage.__version__

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
exclude_patterns = ["examples", "paper", "reference/api/.*"]
myst_enable_extensions = ["colon_fence", "deflist", "dollarmath"]
myst_heading_anchors = 3

autodoc_member_order = "bysource"
autodoc_typehints = "none"
napoleon_google_docstring = False
napoleon_use_ivar = True
napoleon_custom_sections = ["Validity", "Equation", "Source"]

# Subpackages may each have a class of one name, such as Estimate: the link goes to the first.
suppress_warnings = ["ref.python"]

html_theme = "alabaster"
html_title = "flexstage"
html_math_renderer = "mathml"
html_static_path = ["_static"]
html_theme_options = {
    "description": "Flexure stages: design, verify, identify, drive",
    "page_width": "1180px",
    "body_max_width": "none",
    "show_powered_by": False,
    "show_relbar_bottom": True,
    "font_family": "system-ui, 'Segoe UI', Roboto, 'DejaVu Sans', sans-serif",
    "head_font_family": "system-ui, 'Segoe UI', Roboto, 'DejaVu Sans', sans-serif",
    "code_font_family": "ui-monospace, Consolas, 'DejaVu Sans Mono', monospace",
    # The colours are variables of `_static/custom.css`, which has them for light and dark.
    **dict.fromkeys(("base_bg", "body_bg"), "var(--page)"),
    **dict.fromkeys(
        (
            "base_text",
            "body_text",
            "sidebar_header",
            "sidebar_text",
            "sidebar_link",
            "gray_1",
            "sidebar_list",
            "narrow_sidebar_fg",
            "narrow_sidebar_link",
        ),
        "var(--ink)",
    ),
    "link": "var(--link)",
    "link_hover": "var(--hover)",
    **dict.fromkeys(("footer_text", "table_border"), "var(--muted)"),
    **dict.fromkeys(
        (
            "gray_2",
            "narrow_sidebar_bg",
            "pre_bg",
            "xref_bg",
            "code_highlight_bg",
            "footnote_bg",
            "topic_bg",
            "anchor_hover_bg",
            "highlight_bg",
            "warn_bg",
            "note_bg",
            "admonition_bg",
            "sidebar_search_button",
            "admonition_xref_bg",
        ),
        "var(--soft)",
    ),
    **dict.fromkeys(
        (
            "hr_border",
            "gray_3",
            "sidebar_hr",
            "relbar_border",
            "xref_border",
            "admonition_border",
            "footnote_border",
            "anchor",
            "sidebar_link_underscore",
            "warn_border",
            "note_border",
        ),
        "var(--line)",
    ),
}

# The rooms from low to high. What does not exist yet has no page.
SUBPACKAGES = [
    "base.errors", "base.provenance", "quantities.units", "quantities.quantity",
    "quantities.estimate", "quantities.sensor", "quantities.material", "quantities.characteristic",
    "records", "hinges", "stage", "stage.designs", "system", "lumped", "fem", "hysteresis",
    "measure", "centring", "virtual", "instruments", "control", "experiments",
    "studies", "studies.explore", "export", "report", "report.notebook", "web",
]  # fmt: skip


def _exists(name: str) -> bool:
    try:
        spec = importlib.util.find_spec(name)
    except ModuleNotFoundError:  # the subpackage that it would be a part of
        return False
    return spec is not None and spec.origin is not None


def _hysteresis_models() -> str:
    """The models of the registry: what each is, and the units of its parameters."""
    from flexstage.hysteresis.drive_model import parameter_unit
    from flexstage.hysteresis.identification.model_fit import fits

    lines = ["# Hysteresis models", "", "| name | what it is | parameters, from V to m | fitted |"]
    lines.append("|---|---|---|---|")
    for kind, fit in fits().items():
        units = [
            f"`{f.name}` [{parameter_unit(kind, f.name, 'V', 'm')}]"
            for f in dataclasses.fields(fit.law)
        ]
        what = inspect.getdoc(fit.law).splitlines()[0]
        lines.append(f"| `{kind}` | {fit.law.__name__}: {what} | {', '.join(units)} | {fit.size} |")
    return "\n".join(lines) + "\n"


def write_reference() -> None:
    """Write the page of the command line, one for each subpackage, and the list of these."""
    folder = Path(__file__).parent / "reference" / "api"
    folder.mkdir(exist_ok=True)
    for old in folder.glob("*.md"):
        old.unlink()
    names = [name for name in SUBPACKAGES if _exists(f"flexstage.{name}")]
    for name in names:
        module = f".. automodule:: flexstage.{name}\n   :members:\n   :show-inheritance:"
        if importlib.util.find_spec(f"flexstage.{name}").submodule_search_locations:
            # A package shows what its `__all__` names, in whichever of its modules that is.
            module += "\n   :imported-members:"
        page = f"# flexstage.{name}\n\n```{{eval-rst}}\n{module}\n```\n"
        (folder / f"{name}.md").write_text(page, encoding="utf-8")
    from flexstage.cli import app
    from flexstage.cli.command import command_line_page

    page = folder.parent / "command-line.md"
    page.write_text(command_line_page(app), encoding="utf-8")
    (folder.parent / "evidence.md").write_text(evidence_table.page(), encoding="utf-8")
    (folder / "hysteresis-models.md").write_text(_hysteresis_models(), encoding="utf-8")
    names.append("hysteresis-models")
    listing = "# API reference\n\n```{toctree}\n:maxdepth: 1\n\n" + "\n".join(names)
    (folder / "index.md").write_text(listing + "\n```\n", encoding="utf-8")


write_reference()


def _inline(writer: Any, node: Any) -> None:
    writer.body.append(convert(node.astext()))
    raise SkipNode


def _display(writer: Any, node: Any) -> None:
    text = node.astext()
    # an alignment needs its surroundings
    if "&" in text and "\\begin" not in text:
        text = f"\\begin{{aligned}}{text}\\end{{aligned}}"
    writer.body.append(f'<div class="math">{convert(text, display="block")}</div>')
    raise SkipNode


def _whole_text(
    _app: Any, what: str, _name: str, _of: Any, _options: Any, lines: list[str]
) -> None:
    """Keep napoleon from taking what stands before a colon of a field's first line for its type."""
    if what in ("attribute", "data", "property"):
        lines[:0] = ["..", ""]  # an empty comment, which has no colon


def setup(app: Any) -> None:
    """Write formulas as MathML, which browsers show by themselves: the manual works offline."""
    app.add_html_math_renderer("mathml", (_inline, None), (_display, None))
    app.connect("autodoc-process-docstring", _whole_text, priority=400)  # before napoleon's
