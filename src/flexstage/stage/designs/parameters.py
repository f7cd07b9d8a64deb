"""Families of stages, and their parameters: names, values and meaning."""

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass, is_dataclass
from typing import Any

from flexstage.files.encoder import Encoder, flow_text
from flexstage.files.format import dimension_of, field_types, members, optional_part, required
from flexstage.files.schema import field_texts
from flexstage.quantities.units import readable_text
from flexstage.stage import Stage
from flexstage.stage.file import STAGE_FILE


@dataclass(frozen=True, slots=True, kw_only=True)
class Topology:
    """A family of stages that differ in their dimensions."""

    name: str
    """Name in stage files."""
    title: str
    """Description in one line."""
    source: str
    """Source: author, title, journal, year."""
    parameters: type
    """The dataclass of its dimensions."""
    construct: Callable[[Any], Stage]
    """Builds a stage from dimensions."""

    def usual(self) -> "ParameterSet | None":
        """Return the stage of its usual dimensions, where every dimension has one."""
        if any(required(field) for field, _ in field_types(self.parameters).values()):
            return None
        usual = self.parameters()
        return ParameterSet(
            name=self.name,
            topology=self,
            parameters=usual,
            construct=lambda: self.construct(usual),
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class ParameterSet:
    """A built-in stage: dimensions of a family, with the published figures of that stage."""

    name: str
    """Name, and that of its stage."""
    topology: Topology
    """The family."""
    parameters: Any
    """Dimensions."""
    construct: Callable[[], Stage]
    """Builds it, with its published figures and notes."""


_ENCODER = Encoder(STAGE_FILE)


@dataclass(frozen=True, slots=True, kw_only=True)
class StageParameter:
    """A parameter of a design or of a stage file."""

    name: str
    """Name as `find_stage` sets it, with dots for what is nested."""
    value: Any
    """Value, in SI units; None where there is none."""
    dimension: str
    """Dimension, of `flexstage.quantities.units.DIMENSIONS`; empty where it is no quantity."""
    text: str
    """Value as in a file and for `find_stage`, to the same bits."""
    description: str
    """Description."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Group:
    """A parameter that holds others."""

    name: str
    """Name, with dots for what is nested."""
    description: str
    """Description."""


def entries_of(dimensions: Any, group: str = "") -> Iterator[StageParameter | Group]:
    """Yield the fields of a description: parameters, and groups before their members."""
    texts = field_texts(type(dimensions))
    for field, (_, annotation) in field_types(type(dimensions)).items():
        value, name = getattr(dimensions, field), group + field
        description = re.sub(r"\s*\[[^\]]*\](?=[.;,]|$)", "", texts.get(field, ""))
        kind = optional_part(annotation) or annotation
        if not is_dataclass(value) or kind in STAGE_FILE.forms:
            yield _parameter(name, kind, value, description)
            continue
        yield Group(name=name, description=description)
        if (family := members(kind, STAGE_FILE)) is not None:
            word = next(word for word, cls in family.items() if cls is type(value))
            of = f"One of {', '.join(family)}."
            yield StageParameter(
                name=f"{name}.kind", value=word, dimension="", text=word, description=of
            )
        yield from entries_of(value, f"{name}.")


def _parameter(name: str, kind: Any, value: Any, description: str) -> StageParameter:
    dimension, count = dimension_of(kind) or (None, 0)
    if value is None:
        text = "null"
    elif dimension is not None and not count:
        text = readable_text(value, dimension.name)
    elif dimension is not None:
        text = flow_text([readable_text(v, dimension.name) for v in value])
    else:
        text = flow_text(_ENCODER.encode(kind, value))
    return StageParameter(
        name=name,
        value=getattr(value, "name", value) if kind in STAGE_FILE.forms else value,
        dimension="" if dimension is None else dimension.name,
        text=text,
        description=description,
    )
