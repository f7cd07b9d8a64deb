"""Style of all figures: colours, fonts, and their conversion to bytes or inline SVG."""

import io
import re
from functools import cache
from html import escape
from typing import TYPE_CHECKING, Any

from flexstage.base.errors import ModelError

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.legend import Legend

#: A metre in millimetres, micrometres and nanometres, and a pascal in megapascals.
MM, UM, NM, MPA = 1e3, 1e6, 1e9, 1e-6

# Neutral colours. Inline in a page every colour becomes a CSS variable, so the page can be dark.
INK = "#1b1f24"
MUTED = "#5a6472"
GRID = "#d8dde4"
PAPER = "#fefefe"
BODY = "#e3e8ee"
FIXED = "#c6cdd6"
HATCH = "#aeb7c2"
PLATFORM = "#bcd9ee"
DRIVEN = "#f6d5b3"
_NEUTRAL = {
    INK: "--ink",
    MUTED: "--muted",
    GRID: "--grid",
    PAPER: "--paper",
    BODY: "--body",
    FIXED: "--fixed",
    HATCH: "--hatch",
    PLATFORM: "--platform",
    DRIVEN: "--driven",
}

#: Colours of data, distinct for every colour vision (Okabe and Ito 2008), and of medium lightness
#: for white and black backgrounds.
CYCLE: tuple[str, ...] = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9")

# The same on a dark page.
_DARK = {
    "--paper": "#14181d",
    "--ink": "#e8ecf1",
    "--muted": "#9aa5b3",
    "--grid": "#323a45",
    "--body": "#39434f",
    "--fixed": "#4d5865",
    "--hatch": "#66727f",
    "--platform": "#2f5a78",
    "--driven": "#8a5a2b",
    "--data0": "#4da6e0",
    "--data1": "#ff8b4d",
    "--data2": "#35c79b",
    "--data3": "#e6a8cc",
    "--data4": "#f2ba4b",
    "--data5": "#8fcdf5",
}

#: Dashes of the line of a limit or of a model, and longer ones.
DASHED, LONG_DASHED = (0, (4, 2)), (0, (5, 3))

#: File formats that a figure can be written in.
FORMATS: tuple[str, ...] = ("svg", "png", "pdf")

_VARIABLES = _NEUTRAL | {colour: f"--data{i}" for i, colour in enumerate(CYCLE)}

_SETTINGS: dict[str, Any] = {
    "font.family": "sans-serif",
    # fonts of equal widths, so that a text laid out in one fits in another
    "font.sans-serif": ["DejaVu Sans", "Verdana", "Arial"],
    "font.size": 8.0,
    "mathtext.default": "regular",
    "hatch.linewidth": 0.4,
    "svg.fonttype": "none",
    "svg.hashsalt": "flexstage",
    "pdf.fonttype": 42,
    "path.simplify": True,
}

#: Dots per inch of raster pictures.
_DPI = 150.0
_SCALES = {"m": ("µm", 1e6), "rad": ("µrad", 1e6)}


def css_name(colour: str) -> str:
    """Return the CSS variable of a colour of this module."""
    return _VARIABLES[colour]


def css_variables(*, dark: bool = False) -> str:
    """Return the colours as CSS variables, for a page on white or a dark one."""
    if dark:
        return " ".join(f"{name}: {colour};" for name, colour in _DARK.items())
    return " ".join(f"{name}: {colour};" for colour, name in _VARIABLES.items())


def new_figure(width: float, height: float) -> "Figure":
    """Return a figure of a size [inch] without global state."""
    return _figure_class()(figsize=(width, height), facecolor=PAPER, layout="constrained")


@cache
def _figure_class() -> type["Figure"]:
    from matplotlib.figure import Figure

    class NotebookFigure(Figure):
        """A figure that a notebook shows without any setting."""

        def _repr_svg_(self) -> str:
            return svg_text(self)

    return NotebookFigure


def style_axes(axes: "Axes", *, grid: bool = True) -> None:
    """Apply the common style to axes."""
    axes.set_facecolor(PAPER)
    for side, spine in axes.spines.items():
        spine.set_color(MUTED)
        spine.set_linewidth(0.6)
        spine.set_visible(side in {"left", "bottom"})
    axes.tick_params(which="both", color=MUTED, labelcolor=INK, width=0.6, labelsize=8)
    axes.xaxis.label.set_color(INK)
    axes.yaxis.label.set_color(INK)
    if grid:
        axes.grid(visible=True, which="major", color=GRID, linewidth=0.6)
        axes.set_axisbelow(True)


def panels(
    width: float,
    height: float,
    count: int = 1,
    columns: int = 1,
    *,
    grid: bool = True,
    **layout: Any,
) -> "tuple[Figure, list[Axes]]":
    """Return a figure of a size [inch] with diagrams in the common style, row by row.

    `layout` are arguments of `Figure.subplots`; the remaining places of the last row stay empty.
    """
    figure = new_figure(width, height)
    every = list(figure.subplots(-(-count // columns), columns, squeeze=False, **layout).flat)
    for i, axes in enumerate(every):
        style_axes(axes, grid=grid)
        if i >= count:
            axes.set_axis_off()
    return figure, every[:count]


def one_panel(width: float, height: float, *, grid: bool = True) -> "tuple[Figure, Axes]":
    """Return a figure of a size [inch] with one diagram in the common style."""
    figure, (axes,) = panels(width, height, grid=grid)
    return figure, axes


def add_legend(on: "Axes | Figure", *entries: Any, size: float = 7.5, **look: Any) -> "Legend":
    """Add a legend without a frame, in type of a size [pt]; a dollar sign in it is no formula."""
    legend = on.legend(*entries, fontsize=size, frameon=False, labelcolor=INK, **look)
    for text in legend.get_texts():
        text.set_parse_math(False)
    return legend


def add_shared_legend(figure: "Figure", *, most: int = 4, size: float = 7.5) -> None:
    """Add a legend below all diagrams, each label once, in at most `most` columns."""
    entries: dict[str, Any] = {}
    for axes in figure.axes:
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
            entries.setdefault(label, handle)
    columns = min(len(entries), most) or 1
    add_legend(
        figure, entries.values(), entries, loc="outside lower center", ncols=columns, size=size
    )


def add_arrow(
    axes: "Axes",
    tip: Any,
    start: Any,
    colour: str,
    width: float = 1.2,
    head: float = 8.0,
    **look: Any,
) -> None:
    """Draw an arrow between two points; width of its line and size of its head [pt]."""
    arrow = {"arrowstyle": "-|>", "color": colour, "linewidth": width, "mutation_scale": head}
    axes.annotate("", xy=tip, xytext=start, arrowprops=arrow, **look)


def add_words(
    axes: "Axes",
    text: str,
    at: Any,
    offset: tuple[float, float],
    size: float = 7.5,
    colour: str = INK,
    **look: Any,
) -> None:
    """Write a text at a place with an offset [pt]; a dollar sign in it is no formula."""
    look |= {"fontsize": size, "color": colour, "parse_math": False}
    axes.annotate(text, at, xytext=offset, textcoords="offset points", **look)


def shortened(name: str, letters: int) -> str:
    """Return a name of at most `letters` letters, with an ellipsis where it is cut."""
    return name if len(name) <= letters else f"{name[: letters - 1]}…"


def on_paper(pad: float, alpha: float = 1.0) -> dict[str, Any]:
    """Return the box of a text over lines; its padding is in points."""
    return {"facecolor": PAPER, "edgecolor": "none", "pad": pad, "alpha": alpha}


def set_title(axes: "Axes", text: str, size: float = 9.0) -> None:
    """Set the title of axes, at the left, in type of a size [pt]."""
    # a dollar sign in a name is no formula
    axes.set_title(text, loc="left", fontsize=size, color=INK, pad=7, parse_math=False)


def label_axes(axes: "Axes", x: str = "", y: str = "", size: float = 8.5) -> None:
    """Set the labels of the x and y axis, in type of a size [pt]."""
    axes.set_xlabel(x, fontsize=size, parse_math=False)
    axes.set_ylabel(y, fontsize=size, parse_math=False)


def add_heading(figure: "Figure", text: str, size: float = 9.0, colour: str = INK) -> None:
    """Set a heading over all diagrams, at the left, in type of a size [pt]."""
    figure.suptitle(text, x=0.01, ha="left", fontsize=size, color=colour, parse_math=False)


def scale(unit: str) -> tuple[str, float]:
    """Return the drawn unit of a quantity, and one SI unit in it.

    The unit is in brackets after a space; an unknown unit is empty.
    """
    name, factor = _SCALES.get(unit, (unit, 1.0))
    return (f" [{name}]" if name else "", factor)


def encode(figure: "Figure", kind: str) -> bytes:
    """Turn a figure into the bytes of a file, the same for the same figure."""
    import matplotlib as mpl

    if kind not in FORMATS:
        raise ModelError(f"a figure is written as one of {', '.join(FORMATS)}, got '{kind}'")
    # with a date, files of equal figures would differ
    metadata: dict[str, Any] = {
        "svg": {"Date": None, "Creator": "flexstage"},
        "png": {"Software": "flexstage"},
        "pdf": {"CreationDate": None, "Creator": "flexstage"},
    }[kind]
    buffer = io.BytesIO()
    with mpl.rc_context(_SETTINGS):  # type: ignore[arg-type]
        if kind == "svg":
            _write_svg(figure, buffer, metadata)
        else:
            figure.savefig(buffer, format=kind, dpi=_DPI, facecolor=PAPER, metadata=metadata)
    return buffer.getvalue()


def _write_svg(figure: "Figure", file: io.BytesIO, metadata: dict[str, Any]) -> None:
    """Write a figure as `Figure.savefig` does, but draw it only once."""
    from matplotlib.backends.backend_svg import FigureCanvasSVG

    canvas, dpi, engine = figure.canvas, figure.dpi, figure.get_layout_engine()
    drawing = FigureCanvasSVG(figure)
    try:
        figure.dpi = _DPI
        if engine is not None:
            engine.execute(figure)
            figure.set_layout_engine("none")
            figure.dpi = _DPI  # the layout changes it
        drawing.print_svg(file, metadata=metadata)
    finally:
        figure.set_layout_engine(engine)
        figure.dpi = dpi
        figure.set_canvas(canvas)


def svg_text(figure: "Figure") -> str:
    """Turn a figure into one SVG element with its own colours and size."""
    text = encode(figure, "svg").decode("utf-8")
    return text[text.index("<svg") :]


def inline_svg(figure: "Figure", name: str, title: str) -> str:
    """Turn a figure into SVG for an HTML page with others.

    Neutral colours become CSS variables, ids become unique in the page, and the parts of a separate
    file are removed. `name` is unique in the page and precedes every id; `title` describes the
    figure for screen readers.
    """
    text = svg_text(figure)
    text = re.sub(r"<metadata>.*?</metadata>", "", text, flags=re.DOTALL)
    text = re.sub(r"<style[^>]*>.*?</style>", "", text, flags=re.DOTALL)
    text = re.sub(r"<!--.*?-->", "", text, flags=re.DOTALL)
    text = re.sub(r'\s+xmlns(:\w+)?="[^"]*"', "", text)
    text = text.replace("xlink:href", "href")
    text = re.sub(r'\bid="([^"]+)"', rf'id="{name}-\1"', text)
    text = re.sub(r'href="#([^"]+)"', rf'href="#{name}-\1"', text)
    text = re.sub(r"url\(#([^)]+)\)", rf"url(#{name}-\1)", text)
    for colour, variable in _VARIABLES.items():
        text = text.replace(colour, f"var({variable})")
    # coordinates of a picture of a few hundred points need no more digits; texts are unchanged
    text = re.sub(r"<[^>]+>", lambda tag: re.sub(r"(\d+\.\d{2})\d+", r"\1", tag[0]), text)
    opening, content = text.split(">", 1)
    opening = re.sub(r'\s(width|height|version)="[^"]*"', "", opening)
    return f'{opening} class="plot" role="img" aria-label="{escape(title, quote=True)}">{content}'
