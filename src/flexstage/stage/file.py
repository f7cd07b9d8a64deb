"""Reads and writes stage files: YAML with units in the text.

A file begins with ``flexstage: 1``, the version of the format. It either spells the stage out or
names a parametric design. ``length_unit: mm`` at the top gives lengths without a unit one.
"""

import os
import re
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from flexstage.errors import FlexstageError, StageError
from flexstage.files.decoder import Decoder, read
from flexstage.files.encoder import Encoder
from flexstage.files.format import check_name, field_types
from flexstage.files.nodes import Given, Node, Scalar, read_text
from flexstage.files.nodes import Mapping as MappingNode
from flexstage.files.parameters import FileParameter, overridden, require_known, settings_of
from flexstage.files.write import write_whole
from flexstage.files.yaml_text import yaml_text
from flexstage.stage.copies import (
    COPIES,
    PROFILES,
    read_with_copies,
    with_profiles_written_out,
    with_shared_profiles,
)
from flexstage.stage.format import STAGE_FILE
from flexstage.stage.model import Stage
from flexstage.units import DIMENSIONS

#: Builds a stage from the name of a design and its parameters.
DesignBuilder = Callable[[str, Mapping[str, object]], Stage]

_HEAD = ("flexstage", "length_unit", "parameters", "design")
# what a file may call the stage of a design
_CALLED = ("name", "title")
_NAMED = {"hinge": "hinges", "drive": "drives", "probe": "probes", "axis": "axes"}


def read_stage(
    path: str | os.PathLike[str],
    designs: DesignBuilder | None = None,
    *,
    set: Mapping[str, object] | None = None,
) -> Stage:
    """Read a stage file.

    Parameters
    ----------
    path : str or os.PathLike
        The file.
    designs : callable, optional
        Builds a stage from the name of a design and its parameters, such as
        ``flexstage.designs.build``; without it a file with ``design:`` is refused.
    set : mapping, optional
        Parameters of its design by name, with dots for those of a group, and values as the file
        has them; they stand in place of those in the file.

    Returns
    -------
    Stage
        The stage.

    Raises
    ------
    FlexstageError
        There is no such file, or it does not hold a possible stage; the message is one sentence
        with file, line and key.
    """
    text = read_text(Path(path), STAGE_FILE.noun, StageError)
    return stage_from_text(text, designs, set=set, source=os.fspath(path))


def stage_from_text(
    text: str,
    designs: DesignBuilder | None = None,
    *,
    set: Mapping[str, object] | None = None,
    source: str = "stage file",
) -> Stage:
    """Read a stage from the text of a stage file.

    Parameters
    ----------
    text : str
        The text.
    designs : callable, optional
        Builds a stage from the name of a design and its parameters.
    set : mapping, optional
        Parameters by name, as `read_stage` takes them.
    source : str
        What to call the text in messages.

    Returns
    -------
    Stage
        The stage.

    Raises
    ------
    FlexstageError
        The text does not hold a possible stage.

    Examples
    --------
    >>> stage = stage_from_text('''
    ... flexstage: 1
    ... length_unit: mm
    ... name: plate
    ... thickness: 8 mm
    ... material: Al 7075-T6
    ... bodies:
    ...   base: {fixed: true, outline: [[0, 0], [30, 0], [30, 20], [0, 20]]}
    ... ''')
    >>> stage.body("base").outline.points[2]
    (0.03, 0.02)
    """
    decoder, root = read(text, source, STAGE_FILE, settings_of(set or {}, StageError))
    if "design" in root.items:
        decoder.check_keys(root, "", (*_HEAD, *_CALLED))
        found = _from_design(decoder, root.items["design"], designs)
        words = {key: decoder.text(root.items[key], key) for key in _CALLED if key in root.items}
        if "name" in words:
            check_name(words["name"], lambda text: decoder.refuse(root.items["name"], "name", text))
        return replace(found, **words) if words else found
    for name in decoder.settings.items:
        require_known(source, name, decoder.parameters, StageError)
    also = (*_HEAD, PROFILES, *COPIES)
    decoder.check_keys(root, "", [*also, *field_types(Stage)])
    root = with_profiles_written_out(decoder, root)
    parts: dict[str, Any] = {}
    origins: dict[tuple[str, str], tuple[int | None, str]] = {}
    if COPIES.keys() & root.items.keys():
        parts, origins = read_with_copies(decoder, root)
    # the names are looked up by the stage itself, which does not know lines: find them again
    try:
        stage = decoder.build(Stage, root, "", parts, also=(*also, *parts))
    except FlexstageError as error:
        raise _placed(error, decoder, root, origins) from None
    check_name(stage.name, lambda text: decoder.refuse(root.items["name"], "name", text))
    return stage


def file_parameters(
    text: str,
    designs: Callable[[str, Mapping[str, object]], object],
    *,
    set: Mapping[str, object] | None = None,
    source: str = "stage file",
) -> dict[str, FileParameter]:
    """Return the parameters of a stage file; `designs` is given the design that it may name."""
    decoder, root = read(text, source, STAGE_FILE, settings_of(set or {}, StageError))
    if "design" in root.items:
        _from_design(decoder, root.items["design"], designs)
    return decoder.parameters


def stage_to_text(stage: Stage, *, shared: bool = False) -> str:
    """Write a stage as the text of a stage file.

    Parameters
    ----------
    stage : Stage
        The stage.
    shared : bool
        Whether each profile is written once, under a name that its hinges have, with its dimensions
        as parameters of the file.

    Returns
    -------
    str
        YAML that `stage_from_text` reads back to the same bits.

    Raises
    ------
    StageError
        A name could not be read back.
    """
    for thing in (stage, *stage.bodies, *stage.hinges, *stage.drives, *stage.probes, *stage.axes):
        check_name(thing.name, _refuse_name)
    encoder = Encoder(STAGE_FILE, DIMENSIONS["length"].units[0])
    return yaml_text(with_shared_profiles(encoder, stage) if shared else encoder.document(stage))


def write_stage(stage: Stage, path: str | os.PathLike[str], *, shared: bool = False) -> None:
    """Write a stage file; it appears whole or not at all.

    Parameters
    ----------
    stage : Stage
        The stage.
    path : str or os.PathLike
        The file; an existing one is replaced.
    shared : bool
        Whether profiles are shared and have parameters, as in `stage_to_text`.

    Raises
    ------
    StageError
        The file cannot be written, or a name could not be read back.
    """
    write_whole(path, stage_to_text(stage, shared=shared).encode("utf-8"), StageError)


def _from_design(
    decoder: Decoder, node: Node, designs: Callable[[str, Mapping[str, object]], Any] | None
) -> Any:
    if not isinstance(node, MappingNode) or not isinstance(node.items.get("name"), Scalar):
        decoder.refuse(node, "design", "expected a mapping with the name of a design")
    if designs is None:
        decoder.refuse(node, "design", "parametric designs are not available here")
    name = node.items["name"]
    for key in ("name", "based_on"):
        if key in decoder.settings.items:
            raise StageError(f"'{key}' of a design is no parameter: change it in {decoder.source}")
    rest = {key: value for key, value in node.items.items() if key != "name"}
    entry = overridden(MappingNode(node.line, rest, node.key_lines), decoder.settings)
    given = Given(entry, decoder)
    try:
        return designs(name.text if isinstance(name, Scalar) else "", given)
    except FlexstageError as error:
        # the parameter that is at fault is named in the message: point at its line
        culprit = next(
            (k for k in node.items if f"'{k}'" in str(error) or f"{k}:" in str(error)), None
        )
        place = node if culprit is None else node.items[culprit]
        decoder.refuse_again(place, "design", error)


def _placed(
    error: FlexstageError,
    decoder: Decoder,
    root: MappingNode,
    origins: Mapping[tuple[str, str], tuple[int | None, str]],
) -> FlexstageError:
    """Point an error of the whole stage at the thing that it is about."""
    text = str(error)
    start = f"{decoder.source}, line {root.line}: "
    if not text.startswith(start):
        return error
    text = text.removeprefix(start)
    if found := re.match(r"(hinge|drive|probe|axis) '(.*?)' ", text):
        group = root.items.get(_NAMED[found[1]])
        if (copied := (_NAMED[found[1]], found[2])) in origins:
            line, path = origins[copied]
            return type(error)(f"{decoder.source}, line {line}, {path}: {text}")
        if isinstance(group, MappingNode) and found[2] in group.key_lines:
            path = f"{_NAMED[found[1]]}.{found[2]}"
            return type(error)(
                f"{decoder.source}, line {group.key_lines[found[2]]}, {path}: {text}"
            )
    return error


def _refuse_name(message: str) -> None:
    raise StageError(message)
