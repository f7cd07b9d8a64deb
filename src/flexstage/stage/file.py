"""Reads and writes stage files: YAML with units in the text.

A file begins with ``flexstage: 1``, the version of the format. It either spells the stage out or
names a parametric design. ``length_unit: mm`` at the top gives lengths without a unit one.
"""

import os
import re
import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from flexstage.choose import did_you_mean
from flexstage.errors import FlexstageError, StageError
from flexstage.stage.decoder import Decoder
from flexstage.stage.encoder import Number, encode
from flexstage.stage.field_types import check_name, field_types
from flexstage.stage.model import Stage
from flexstage.stage.yaml_reader import Mapping as MappingNode
from flexstage.stage.yaml_reader import Node, Scalar, parse_yaml, plain, read_text
from flexstage.stage.yaml_writer import yaml_text
from flexstage.units import DIMENSIONS

#: Version of the format, the value of the key ``flexstage``.
FORMAT_VERSION = 1

#: Builds a stage from the name of a design and its parameters.
DesignBuilder = Callable[[str, Mapping[str, object]], Stage]

_HEAD = ("flexstage", "length_unit", "design")
_NAMED = {"hinge": "hinges", "drive": "drives", "probe": "probes", "axis": "axes"}


def read_stage(path: str | os.PathLike[str], designs: DesignBuilder | None = None) -> Stage:
    """Read a stage file.

    Parameters
    ----------
    path : str or os.PathLike
        The file.
    designs : callable, optional
        Builds a stage from the name of a design and its parameters, such as
        ``flexstage.designs.build``; without it a file with ``design:`` is refused.

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
    text = read_text(Path(path))
    return stage_from_text(text, designs, source=os.fspath(path))


def stage_from_text(
    text: str, designs: DesignBuilder | None = None, *, source: str = "stage file"
) -> Stage:
    """Read a stage from the text of a stage file.

    Parameters
    ----------
    text : str
        The text.
    designs : callable, optional
        Builds a stage from the name of a design and its parameters.
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
    root = parse_yaml(text, source)
    decoder = Decoder(source, bounded=True)
    if not isinstance(root, MappingNode):
        decoder.refuse(root, "", "a stage file is a mapping that begins with 'flexstage: 1'")
    _check_version(decoder, root)
    decoder.length_unit = _length_unit(decoder, root)
    if "design" in root.items:
        decoder.check_keys(root, "", list(_HEAD))
        return _from_design(decoder, root.items["design"], designs)
    known = list(field_types(Stage))
    decoder.check_keys(root, "", [*_HEAD, *known])
    rest = MappingNode(
        root.line, {k: v for k, v in root.items.items() if k not in _HEAD}, root.key_lines
    )
    # the names are looked up by the stage itself, which does not know lines: find them again
    try:
        stage = decoder.build(Stage, rest, "")
    except FlexstageError as error:
        raise _placed(error, decoder, root) from None
    check_name(stage.name, lambda text: decoder.refuse(root.items["name"], "name", text))
    return stage


def stage_to_text(stage: Stage) -> str:
    """Write a stage as the text of a stage file.

    Parameters
    ----------
    stage : Stage
        The stage.

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
    unit = DIMENSIONS["length"].units[0]
    data: dict[str, Any] = {"flexstage": Number(FORMAT_VERSION), "length_unit": unit}
    data.update(encode(Stage, stage, unit))
    return yaml_text(data)


def write_stage(stage: Stage, path: str | os.PathLike[str]) -> None:
    """Write a stage file; it appears whole or not at all.

    Parameters
    ----------
    stage : Stage
        The stage.
    path : str or os.PathLike
        The file; an existing one is replaced.

    Raises
    ------
    StageError
        The file cannot be written, or a name could not be read back.
    """
    target = Path(path)
    data = stage_to_text(stage).encode("utf-8")
    temporary: str | None = None
    try:
        mode = target.stat().st_mode & 0o777 if target.exists() else 0o666 & ~_umask()
        handle, temporary = tempfile.mkstemp(prefix=f".{target.name}.", dir=target.parent)
        with os.fdopen(handle, "wb") as stream:
            stream.write(data)
            stream.flush()
            os.fsync(stream.fileno())
        Path(temporary).chmod(mode)
        Path(temporary).replace(target)
        temporary = None
    except OSError as error:
        raise StageError(f"the file {target} cannot be written: {error.strerror}") from None
    finally:
        if temporary is not None:
            Path(temporary).unlink(missing_ok=True)


def _umask() -> int:
    # it can only be read by setting it
    mask = os.umask(0o077)
    os.umask(mask)
    return mask


def _check_version(decoder: Decoder, root: MappingNode) -> None:
    version = root.items.get("flexstage")
    if version is None:
        decoder.refuse(root, "", f"'flexstage: {FORMAT_VERSION}' is missing at the top of the file")
    value = version.value if isinstance(version, Scalar) else None
    if value != FORMAT_VERSION or isinstance(value, (bool, str)):
        got = f"'{version.text[:40]}'" if isinstance(version, Scalar) else "something else"
        decoder.refuse(
            version, "flexstage", f"expected version {FORMAT_VERSION} of the format, got {got}"
        )


def _length_unit(decoder: Decoder, root: MappingNode) -> str | None:
    node = root.items.get("length_unit")
    if node is None:
        return None
    name = node.text if isinstance(node, Scalar) else ""
    units = DIMENSIONS["length"].units
    if name not in units:
        hint = did_you_mean(name, units)
        decoder.refuse(
            node, "length_unit", f"expected one of {', '.join(units)}, got '{name[:40]}'{hint}"
        )
    return name


def _from_design(decoder: Decoder, node: Node, designs: DesignBuilder | None) -> Stage:
    if not isinstance(node, MappingNode) or not isinstance(node.items.get("name"), Scalar):
        decoder.refuse(node, "design", "expected a mapping with the name of a design")
    if designs is None:
        decoder.refuse(node, "design", "parametric designs are not available here")
    parameters = {k: plain(v) for k, v in node.items.items() if k != "name"}
    name = node.items["name"]
    try:
        return designs(name.text if isinstance(name, Scalar) else "", parameters)
    except FlexstageError as error:
        # the parameter that is at fault is named in the message: point at its line
        culprit = next(
            (k for k in node.items if f"'{k}'" in str(error) or f"{k}:" in str(error)), None
        )
        place = node if culprit is None else node.items[culprit]
        decoder.refuse(place, "design", str(error), type(error))


def _placed(error: FlexstageError, decoder: Decoder, root: MappingNode) -> FlexstageError:
    """Point an error of the whole stage at the thing that it is about."""
    text = str(error)
    start = f"{decoder.source}, line {root.line}: "
    if not text.startswith(start):
        return error
    text = text.removeprefix(start)
    if found := re.match(r"(hinge|drive|probe|axis) '(.*?)' ", text):
        group = root.items.get(_NAMED[found[1]])
        if isinstance(group, MappingNode) and found[2] in group.key_lines:
            path = f"{_NAMED[found[1]]}.{found[2]}"
            return type(error)(
                f"{decoder.source}, line {group.key_lines[found[2]]}, {path}: {text}"
            )
    if text.startswith("the thickness") and "thickness" in root.key_lines:
        line = root.key_lines["thickness"]
        return type(error)(f"{decoder.source}, line {line}, thickness: {text}")
    return error


def _refuse_name(message: str) -> None:
    raise StageError(message)
