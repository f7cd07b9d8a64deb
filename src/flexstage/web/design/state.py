"""State of the view Design in one browser: a stage, its parameter values, and its figures."""

from collections import OrderedDict
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import Generic, TypeVar

from flexstage.quantities.characteristic import Characteristic
from flexstage.stage import Stage
from flexstage.stage.designs import StageTemplate
from flexstage.studies.explore.sensitivity import Sensitivities
from flexstage.studies.explore.variables import Variable, every_variable
from flexstage.web.sessions import History

T = TypeVar("T")

#: Range of a slider on either side of the nominal value, relative to it [1].
SHARE = 0.3
#: The design of a new page, and its most effective parameters; other groups are folded.
FIRST = "parallelogram"
FIRST_OPEN = (
    "leg.notch.neck_thickness", "leg.notch.radius", "leg.bar_length", "leg_spacing",
    "platform_height", "platform_overhang",
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Variant:
    """A design or stage file with changed parameters."""

    template: StageTemplate
    """The design or stage file."""
    values: tuple[tuple[str, float], ...] = ()
    """Parameters that are changed, by name, in SI units."""

    @property
    def name(self) -> str:
        """Name of the design or of the file."""
        return Path(self.template.source).name

    def stage(self) -> Stage:
        """Return the stage."""
        return self.template.stage(dict(self.values))

    def changed(self, name: str, value: float, nominal: float) -> "Variant":
        """Return the variant with another value of a parameter; the nominal value is no change."""
        others = {parameter: present for parameter, present in self.values if parameter != name}
        if value != nominal:
            others[name] = value
        return replace(self, values=tuple(sorted(others.items())))


class Cached(Generic[T]):
    """Results of the last variants."""

    def __init__(self) -> None:
        self._results: OrderedDict[Variant, T] = OrderedDict()

    def put(self, variant: Variant, result: T) -> None:
        """Store the result of a variant."""
        self._results[variant] = result
        while len(self._results) > 100:
            self._results.popitem(last=False)

    def get(self, variant: Variant | None) -> T | None:
        """Return the result of a variant, or None."""
        return None if variant is None else self._results.get(variant)


def _first() -> History[Variant]:
    return History(Variant(StageTemplate.of(FIRST)))


@dataclass
class DesignState:
    """State of the view Design in one browser."""

    history: History[Variant] = field(default_factory=_first)
    """The open variant and its predecessors."""
    now: Variant = field(init=False)
    """The displayed variant; it joins the history at the end of a change."""
    pinned: Variant | None = None
    """The variant for comparison."""
    axis: str = ""
    """Axis of the displayed sensitivities."""
    order: str = ""
    """Figure whose sensitivity orders the sliders; empty for the order of the stage."""
    lumped: Cached[tuple[Characteristic, ...]] = field(default_factory=Cached)
    """Characteristics by the lumped model."""
    corrected: Cached[tuple[Characteristic, ...]] = field(default_factory=Cached)
    """Characteristics by the superelement model."""
    slopes: Cached[Sensitivities] = field(default_factory=Cached)
    """Sensitivity of each figure to each parameter."""

    def __post_init__(self) -> None:
        self.now = self.history.now

    @property
    def variables(self) -> tuple[Variable, ...]:
        """Parameters with a slider."""
        return _variables(self.now.template)

    def value(self, variable: Variable) -> float:
        """Return the present value of a parameter [SI]."""
        return dict(self.now.values).get(variable.name, variable.usual)

    def open(self, template: StageTemplate) -> None:
        """Open another design or file."""
        self.show(Variant(template))
        self.commit()

    def show(self, variant: Variant) -> None:
        """Show a variant during a change."""
        self.now = variant

    def commit(self) -> None:
        """End a change, so that it can be undone."""
        self.history.put(self.now)

    def undo(self) -> None:
        """Return to the previous variant."""
        self.commit()
        self.history.undo()
        self.now = self.history.now

    def redo(self) -> None:
        """Revert the last undo."""
        self.history.redo()
        self.now = self.history.now


@lru_cache(maxsize=64)
def _variables(template: StageTemplate) -> tuple[Variable, ...]:
    return every_variable(template, SHARE)
