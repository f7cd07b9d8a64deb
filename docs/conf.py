"""The manual: Sphinx with MyST, and a reference page for every room that exists."""

import importlib.util
from pathlib import Path
from typing import Any

from docutils.nodes import SkipNode
from latex2mathml.converter import convert

import flexstage

project = "flexstage"
author = "The flexstage developers"
copyright = "2026, The flexstage developers"
version = release = flexstage.__version__

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
exclude_patterns = ["examples", "reference/api/.*"]
myst_enable_extensions = ["colon_fence", "deflist", "dollarmath"]
myst_heading_anchors = 3

autodoc_member_order = "bysource"
autodoc_typehints = "none"
napoleon_google_docstring = False
napoleon_use_ivar = True
napoleon_custom_sections = ["Validity", "Equation", "Source"]

# Rooms may each have a class of one name, such as Estimate: the link goes to the first of them.
suppress_warnings = ["ref.python"]

html_theme = "alabaster"
html_title = "flexstage"
html_math_renderer = "mathml"
html_static_path = ["_static"]
html_theme_options = {
    "description": "Flexure stages: design, verify, identify, drive",
    "page_width": "1180px",
    "body_max_width": "none",
}

# The rooms from low to high, and the parts of a room that are not named in its own `__all__`. What
# does not exist yet has no page.
ROOMS = [
    "errors", "units", "estimate", "material", "characteristic", "provenance",
    "records", "hinges", "stage", "designs", "system", "lumped",
    "fem", "hysteresis",
    "experiment.spectra", "experiment.modal", "experiment.motion", "experiment.noise",
    "experiment.uncertainty", "experiment.significance", "experiment.updating",
    "experiment.campaign", "experiment.virtual",
    "centring",
    "instruments.connect", "instruments.protocol", "instruments.waveform", "instruments.servo",
    "instruments.limits", "instruments.checks", "instruments.acquire", "instruments.ramp",
    "instruments.guard", "instruments.lock", "instruments.gcs", "instruments.ni",
    "instruments.recording", "instruments.catalogue", "instruments.twin.build",
    "instruments.twin.stage",
    "control", "plans", "explore", "export", "report", "web",
]  # fmt: skip


def _exists(name: str) -> bool:
    try:
        spec = importlib.util.find_spec(name)
    except ModuleNotFoundError:  # the room that it would be a part of
        return False
    return spec is not None and spec.origin is not None


def write_reference() -> None:
    """Write the page of the command line, one page for each room, and the list of them."""
    folder = Path(__file__).parent / "reference" / "api"
    folder.mkdir(exist_ok=True)
    for old in folder.glob("*.md"):
        old.unlink()
    rooms = [room for room in ROOMS if _exists(f"flexstage.{room}")]
    for room in rooms:
        module = f".. automodule:: flexstage.{room}\n   :members:\n   :show-inheritance:"
        if importlib.util.find_spec(f"flexstage.{room}").submodule_search_locations:
            # A room shows what its `__all__` names, wherever in the room that lives.
            module += "\n   :imported-members:"
        page = f"# flexstage.{room}\n\n```{{eval-rst}}\n{module}\n```\n"
        (folder / f"{room}.md").write_text(page, encoding="utf-8")
    from flexstage.cli.reference import command_line_page

    page = folder.parent / "command-line.md"
    page.write_text(command_line_page(), encoding="utf-8")
    listing = "# The rooms of the library\n\n```{toctree}\n:maxdepth: 1\n\n" + "\n".join(rooms)
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


def setup(app: Any) -> None:
    """Write formulas as MathML, which browsers show by themselves: the manual works offline."""
    app.add_html_math_renderer("mathml", (_inline, None), (_display, None))
