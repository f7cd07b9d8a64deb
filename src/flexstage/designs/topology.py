"""What a parametric design says of itself, and a stage that is built in."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from flexstage.files.format import field_types, required
from flexstage.stage import Stage


@dataclass(frozen=True, slots=True, kw_only=True)
class Topology:
    """A family of stages that differ in their dimensions; its file ends with one, ``TOPOLOGY``."""

    name: str
    """Its name in stage files."""
    title: str
    """One line that says what it is."""
    source: str
    """Where it is described: author, title, journal, year."""
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
    """A built-in stage: dimensions of a family, and what is known of the stage that has them."""

    name: str
    """Its name, and that of its stage."""
    topology: Topology
    """The family."""
    parameters: Any
    """Its dimensions."""
    construct: Callable[[], Stage]
    """Builds it, with its published figures and notes."""
