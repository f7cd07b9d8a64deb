"""Stage files to start from: the text of a design with every dimension, or of its whole stage."""

import textwrap
from collections.abc import Iterable, Mapping
from typing import Any

from flexstage.designs.parameters import Group, StageParameter, entries_of
from flexstage.designs.registry import PARAMETER_SETS, design
from flexstage.designs.topology import ParameterSet, Topology
from flexstage.stage import stage_to_text

_WIDTH = 100
_COLUMN = 34  # where comments begin, at least

_OF_KEYS = {
    "parameters": 'Dimensions of the notches: change one here, or by --set NAME="VALUE". The gap '
    "between two bodies is as long as the notch that fills it.",
    "profiles": "Shapes that hinges have by name.",
    "name": "The plate.",
    "bodies": "Outlines leave the notches out: each fills the gap between the edges of two bodies.",
    "hinges": "Each joins two bodies: its neck is at a point, its direction is from the first on.",
    "drives": "What pushes which body, and which it stands on: the point pushed, the other end.",
    "probes": "Where the motion of a body is read, and in which direction.",
    "axes": "Which drives and which probe belong together.",
    "published": "Figures of others for this very stage: delete them when you change it.",
}


def design_text(name: str) -> str:
    """Return a stage file that names a built-in design and gives all of its dimensions.

    Examples
    --------
    >>> print(design_text("parallelogram").splitlines()[0])
    # Parallelogram guide on two legs of notches or leaves.
    """
    known = PARAMETER_SETS[name]
    return text_of_dimensions(known.topology, known, known.parameters)


def text_of_dimensions(topology: Topology, known: ParameterSet | None, dimensions: Any) -> str:
    """Return a stage file that names a family and gives all dimensions.

    `known` is the built-in design that they vary, where it is one.
    """
    lines = [
        *_head(
            topology, "Every dimension of the design is here, with its value: change or delete it."
        ),
        "flexstage: 1",
        "design:",
        f"  name: {topology.name}",
    ]
    if known is not None and known.name != topology.name:
        lines.append(f"  based_on: {known.name}")
    return "\n".join([*lines, *_entries(entries_of(dimensions))]) + "\n"


def spelled_out_text(name: str) -> str:
    """Return a stage file in which the stage of a built-in design is described part by part."""
    said = "The whole stage is described here, without the design that it was made from."
    text = _with_comments(stage_to_text(design(name), shared=True), _OF_KEYS)
    return "\n".join([*_head(PARAMETER_SETS[name].topology, said), text])


def _head(topology: Topology, said: str) -> list[str]:
    title = topology.title
    told = [
        f"{title[:1].upper()}{title[1:]}" + ("" if title.endswith(".") else "."),
        f"Source: {topology.source.removesuffix('.')}.",
        said,
        "flexstage check FILE says what is wrong with it, flexstage show FILE draws it.",
    ]
    return [line for text in told for line in _comment(text, "")] + [""]


def _comment(text: str, indent: str) -> list[str]:
    prefix = f"{indent}# "
    return textwrap.wrap(
        text, _WIDTH, initial_indent=prefix, subsequent_indent=prefix, break_on_hyphens=False
    )


def _entries(entries: Iterable[StageParameter | Group]) -> list[str]:
    """Lines of a mapping of parameters, nested as their names are, with comments."""
    lines = []
    for entry in entries:
        *groups, key = entry.name.split(".")
        indent = "  " * (len(groups) + 1)
        if isinstance(entry, Group):
            lines += [*_comment(entry.description, indent), f"{indent}{key}:"]
            continue
        line = f"{indent}{key}: {entry.text}"
        behind = f"{line:<{_COLUMN}}  # {entry.description.removesuffix('.')}"
        if not entry.description:
            lines.append(line)
        elif len(behind) <= _WIDTH:
            lines.append(behind)
        else:
            lines += [*_comment(entry.description, indent), line]
    return lines


def _with_comments(text: str, comments: Mapping[str, str]) -> str:
    """Put comments above the outermost keys of a file."""
    lines = []
    for line in text.splitlines():
        said = comments.get(line.partition(":")[0])
        if said is not None:
            lines += ["", *_comment(said, "")]
        lines.append(line)
    return "\n".join(lines) + "\n"
