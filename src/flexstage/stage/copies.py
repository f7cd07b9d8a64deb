"""Shared profiles, mirror images and patterns of a stage file."""

import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Annotated, Any

from flexstage.base.choose import did_you_mean, unknown
from flexstage.base.errors import StageError
from flexstage.files.decoder import Decoder
from flexstage.files.encoder import Encoder
from flexstage.files.format import check_name, dimension_of, field_types
from flexstage.files.nodes import MAX_NODES, Node, Scalar, Sequence
from flexstage.files.nodes import Mapping as MappingNode
from flexstage.files.parameters import KEY as PARAMETERS
from flexstage.files.ranges import Range, require_ranges
from flexstage.hinges import Profile
from flexstage.quantities.units import Angle
from flexstage.stage.drive import Drive
from flexstage.stage.model import Body, Hinge, Probe, Stage
from flexstage.stage.outline import Loop, Point
from flexstage.stage.transform import PlaneMotion, moved

#: Groups of a stage whose parts can be copied.
GROUPS = ("bodies", "hinges", "drives", "probes")

_Part = Body | Hinge | Drive | Probe
#: Most copies that are made for a file, and most names of an entry.
_MOST, _MOST_NAMES = 10_000, 1_000
_NOUNS = {"bodies": "body", "hinges": "hinge", "drives": "drive", "probes": "probe"}


@dataclass(frozen=True, slots=True, kw_only=True)
class MirrorImages:
    """Mirror images of what the file describes."""

    line: PlaneMotion
    """The line of symmetry: x or y for that axis, {x: 40 mm} or {y: 40 mm} for the line of that
    coordinate, or [[0, 0], [1, 1]] for the line through two points.
    """
    of: tuple[str, ...]
    """Names of bodies, hinges, drives and probes that are mirrored."""
    rename: Mapping[str, str]
    """Words in their names, and the word that replaces each in the names of the images."""

    def copies(self) -> Iterator[tuple[PlaneMotion, Callable[[str], str]]]:
        """Yield the position and the names of each copy."""
        yield self.line, lambda name: _renamed(name, self.rename)


@dataclass(frozen=True, slots=True, kw_only=True)
class Pattern:
    """Copies of what the file describes, turned about a point or shifted."""

    of: tuple[str, ...]
    """Names of bodies, hinges, drives and probes that are copied."""
    count: Annotated[int, Range(low=2, high=1000)]
    """Total number, including the original."""
    turn: Angle | None = None
    """Angle from each to the next, to the left [rad]."""
    about: Point = (0.0, 0.0)
    """The point about which they are turned [m]."""
    step: Point | None = None
    """Displacement from each to the next [m], instead of turn."""
    rename: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    """Words in their names, and the words that replace each in the copies in turn; where not given,
    names end in -2, -3 and so on.
    """

    def __post_init__(self) -> None:
        require_ranges(self, StageError, "a pattern")
        if (self.turn is None) == (self.step is None):
            raise StageError("a pattern needs either 'turn' or 'step'")
        for word, names in self.rename.items():
            if len(names) != self.count - 1:
                raise StageError(
                    f"'{word[:60]}' is renamed in {self.count - 1} copies, got {len(names)} names"
                )

    def copies(self) -> Iterator[tuple[PlaneMotion, Callable[[str], str]]]:
        """Yield the position and the names of each copy."""
        for k in range(1, self.count):
            words = {word: names[k - 1] for word, names in self.rename.items()}
            if self.turn is not None:
                motion = PlaneMotion.rotation(k * self.turn, about=self.about)
            else:
                x, y = self.step or (0.0, 0.0)
                motion = PlaneMotion(shift=(k * x, k * y))
            yield motion, partial(_renamed, words=words) if words else partial(_numbered, k=k + 1)


#: Ways in which a file may copy its parts, by key, in the order in which they are applied.
COPIES: Mapping[str, type[MirrorImages] | type[Pattern]] = {
    "mirror": MirrorImages,
    "pattern": Pattern,
}
#: The key of profiles that hinges name.
PROFILES = "profiles"


def with_profiles_written_out(decoder: Decoder, root: MappingNode) -> MappingNode:
    """Return a file in which each hinge has its profile written out."""
    shared = root.items.get(PROFILES)
    profiles: dict[str, Node] = {}
    if shared is not None:
        profiles = decoder.mapping(shared, PROFILES).items
        for name, node in profiles.items():
            check_name(name, lambda text: decoder.refuse(shared, PROFILES, text))
            decoder.decode(Profile, node, f"{PROFILES}.{name}")
    hinges = root.items.get("hinges")
    if not isinstance(hinges, MappingNode):
        return root
    items = {}
    for key, hinge in hinges.items.items():
        items[key] = hinge
        profile_node = hinge.items.get("profile") if isinstance(hinge, MappingNode) else None
        if isinstance(hinge, MappingNode) and isinstance(profile_node, Scalar):
            if profile_node.text not in profiles:
                _refuse_profile(decoder, profile_node, f"hinges.{key}.profile", profiles)
            inner = {**hinge.items, "profile": profiles[profile_node.text]}
            items[key] = MappingNode(hinge.line, inner, hinge.key_lines)
    hinges = MappingNode(hinges.line, items, hinges.key_lines)
    return MappingNode(root.line, {**root.items, "hinges": hinges}, root.key_lines)


def with_shared_profiles(encoder: Encoder, stage: Stage) -> dict[str, Any]:
    """Return the plain data of a stage in which profiles have names, and their quantities as well.

    They are named by their kind, with numbers where there are several.
    """
    data = encoder.document(stage)
    profiles = list(dict.fromkeys(hinge.profile for hinge in stage.hinges))
    parameters: dict[str, Any] = {}
    shared: dict[str, Any] = {}
    for k, profile in enumerate(profiles, start=1):
        end = f"_{k}" if len(profiles) > 1 else ""
        fields = encoder.fields(profile)
        for name, (_, kind) in field_types(type(profile)).items():
            if name in fields and dimension_of(kind) is not None and isinstance(fields[name], str):
                parameters[f"{name}{end}"] = fields[name]
                fields[name] = f"= {name}{end}"
        shared[f"notch{end}"] = fields
        for hinge in stage.hinges:
            if hinge.profile == profile:
                data["hinges"][hinge.name]["profile"] = f"notch{end}"
    head = {key: data.pop(key) for key in list(data) if key not in field_types(Stage)}
    added = {PARAMETERS: parameters, PROFILES: shared}
    return {**head, **{key: value for key, value in added.items() if value}, **data}


def _refuse_profile(
    decoder: Decoder, node: Scalar, path: str, profiles: Mapping[str, Node]
) -> None:
    if profiles:
        decoder.refuse(node, path, unknown("profile", node.text, profiles, 0.4))
    decoder.refuse(
        node,
        path,
        f"the profile '{node.text[:60]}' is not among '{PROFILES}', which the file does not have: "
        "write it there, or here as a mapping such as {kind: circular, ...}",
    )


def read_with_copies(
    decoder: Decoder, root: MappingNode
) -> tuple[dict[str, Any], dict[tuple[str, str], tuple[int | None, str]]]:
    """Read the parts of a stage that can be copied, and copy them.

    Returns the parts by group, and the line and the keys from which each copy, by its group and
    name, comes.
    """
    kinds = field_types(Stage)
    parts: dict[str, dict[str, _Part]] = {}
    for group in GROUPS:
        node = root.items.get(group)
        read = () if node is None else decoder.decode(kinds[group][1], node, group)
        parts[group] = {part.name: part for part in read}
    origins: dict[tuple[str, str], tuple[int | None, str]] = {}
    points = 0
    for key in (key for key in root.items if key in COPIES):
        for k, entry in enumerate(decoder.items(root.items[key], key, None, "mappings")):
            path = f"{key}[{k}]"
            request = decoder.build(COPIES[key], decoder.mapping(entry, path), path)
            _require_names(decoder, entry, path, request, parts)
            for group, name, copy in _copies(request, parts):
                _require_new(decoder, entry, path, (group, name, copy.name), parts)
                parts[group][copy.name] = copy
                origins[group, copy.name] = (entry.line, path)
                points += _size(copy)
                if len(origins) > _MOST or points > MAX_NODES:
                    most = (
                        f"a file may have at most {_MOST} copies with {MAX_NODES} points in total"
                    )
                    decoder.refuse(entry, path, most)
    return {group: tuple(group_parts.values()) for group, group_parts in parts.items()}, origins


def _require_names(
    decoder: Decoder,
    entry: Node,
    path: str,
    request: MirrorImages | Pattern,
    parts: dict[str, dict[str, _Part]],
) -> None:
    """Refuse names of parts, and words of names, that there are not."""
    if not 0 < len(request.of) <= _MOST_NAMES or len(request.rename) > _MOST_NAMES:
        message = f"expected 1 to {_MOST_NAMES} names, got {len(request.of)}"
        decoder.refuse(_place(entry, "of", ""), f"{path}.of", message)
    every = {name for group_parts in parts.values() for name in group_parts}
    for name in request.of:
        if name not in every:
            hint = did_you_mean(name, every, 0.5)
            message = f"there is no body, hinge, drive or probe '{name[:60]}'{hint}"
            decoder.refuse(_place(entry, "of", name), f"{path}.of", message)
    for word in request.rename:
        if not any(_renamed(name, {word: ""}) != name for name in request.of):
            message = f"no name in 'of' has the word '{word[:60]}'"
            decoder.refuse(_place(entry, "rename", word), f"{path}.rename", message)


def _copies(
    request: MirrorImages | Pattern, parts: dict[str, dict[str, _Part]]
) -> Iterator[tuple[str, str, _Part]]:
    """Yield the copies that an entry asks for, each with its group and the name that it is of."""
    of = dict.fromkeys(request.of)
    first = [
        (group, group_parts[name])
        for group, group_parts in parts.items()
        for name in of
        if name in group_parts
    ]
    outside = {body for _, part in first for body in _stands_on(part)} - of.keys()
    for motion, rename in request.copies():
        names = {name: rename(name) for name in of}
        copied_bodies = {names[part.name] for group, part in first if group == "bodies"}
        # a body that is not copied: that of the new name where there is one, or else itself
        for body in outside:
            new = rename(body)
            names[body] = new if new in parts["bodies"] or new in copied_bodies else body
        for group, part in first:
            yield group, part.name, moved(part, motion, names)


def _require_new(
    decoder: Decoder,
    entry: Node,
    path: str,
    copied: tuple[str, str, str],
    parts: dict[str, dict[str, _Part]],
) -> None:
    """Refuse a copy that is called like another part; `copied` is its group, of what, its name."""
    group, name, new = copied
    check_name(new, lambda text: decoder.refuse(entry, path, text))
    if new in parts[group]:
        decoder.refuse(
            entry,
            path,
            f"the copy of {_NOUNS[group]} '{name}' would be called '{new}', a name that is in "
            "use: give another name in 'rename'",
        )


def _stands_on(part: _Part) -> tuple[str, ...]:
    """Return the names of the bodies to which a part refers."""
    match part:
        case Hinge():
            return part.bodies
        case Drive():
            return (part.pushes, part.reacts)
        case Probe():
            return (part.body, *(() if part.relative_to is None else (part.relative_to,)))
    return ()


def _place(entry: Node, key: str, word: str) -> Node:
    """Return the position of a word of an entry."""
    assert isinstance(entry, MappingNode)
    node = entry.items[key]
    if isinstance(node, MappingNode):
        return Scalar(node.key_lines.get(word, node.line), word, word)
    items = node.items if isinstance(node, Sequence) else []
    return next((i for i in items if isinstance(i, Scalar) and i.text == word), node)


def _numbered(name: str, k: int) -> str:
    return f"{name}-{k}"


def _renamed(name: str, words: Mapping[str, str]) -> str:
    """Replace whole words of a name: runs of letters, or of digits, as others are between them."""
    patterns = []
    for word in sorted(words, key=len, reverse=True):
        before, after = _boundary(word[0]), _boundary(word[-1])
        patterns.append(f"{before and f'(?<!{before})'}{re.escape(word)}{after and f'(?!{after})'}")
    return re.sub("|".join(patterns), lambda match: words[match[0]], name) if words else name


def _boundary(character: str) -> str:
    """Return the characters that must not adjoin a word that begins or ends so."""
    if character.isdigit():
        return r"\d"
    return r"[^\W\d_]" if character.isalpha() else ""


def _size(part: _Part) -> int:
    if not isinstance(part, Body):
        return 1
    loops = (part.outline, *(hole for hole in part.holes if isinstance(hole, Loop)))
    return 1 + sum(len(loop.points) for loop in loops)
