"""What is open in the view Design: a stage with values of its parameters, and its figures."""

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

#: How far a slider goes to either side of the value of the description [1].
SHARE = 0.3
#: The design that a new page opens, and its parameters that move its figures: all else is folded.
FIRST = "parallelogram"
FIRST_OPEN = (
    "leg.notch.neck_thickness", "leg.notch.radius", "leg.bar_length", "leg_spacing",
    "platform_height", "platform_overhang",
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Variant:
    """A design or stage file with some parameters changed."""

    template: StageTemplate
    """The design or stage file."""
    values: tuple[tuple[str, float], ...] = ()
    """Parameters that are changed, by name, in SI units."""

    @property
    def name(self) -> str:
        """What it is called: the design, or the name of its file."""
        return Path(self.template.source).name

    def stage(self) -> Stage:
        """Return the stage."""
        return self.template.stage(dict(self.values))

    def changed(self, name: str, value: float, usual: float) -> "Variant":
        """Return it with another value of one parameter; the usual value is no change."""
        others = {known: old for known, old in self.values if known != name}
        if value != usual:
            others[name] = value
        return replace(self, values=tuple(sorted(others.items())))


class Cached(Generic[T]):
    """What was computed of the last variants."""

    def __init__(self) -> None:
        self._known: OrderedDict[Variant, T] = OrderedDict()

    def put(self, variant: Variant, found: T) -> None:
        """Remember what was found of a variant."""
        self._known[variant] = found
        while len(self._known) > 100:
            self._known.popitem(last=False)

    def get(self, variant: Variant | None) -> T | None:
        """Return what was found of a variant, if anything."""
        return None if variant is None else self._known.get(variant)


def _first() -> History[Variant]:
    return History(Variant(StageTemplate.of(FIRST)))


@dataclass
class DesignState:
    """What one person has open in the view Design."""

    history: History[Variant] = field(default_factory=_first)
    """The variant that is open, and those before it."""
    now: Variant = field(init=False)
    """The variant that is shown; it is put into the history when a change ends."""
    kept: Variant | None = None
    """The variant that it is compared with."""
    axis: str = ""
    """The axis whose sensitivities are shown."""
    order: str = ""
    """The figure by whose sensitivity the sliders are ordered; empty as the stage has them."""
    lumped: Cached[tuple[Characteristic, ...]] = field(default_factory=Cached)
    """Characteristics by the lumped model."""
    corrected: Cached[tuple[Characteristic, ...]] = field(default_factory=Cached)
    """Characteristics by superelements."""
    slopes: Cached[Sensitivities] = field(default_factory=Cached)
    """What each parameter does to each figure."""

    def __post_init__(self) -> None:
        self.now = self.history.now

    @property
    def variables(self) -> tuple[Variable, ...]:
        """The parameters that have a slider."""
        return _variables(self.now.template)

    def value(self, variable: Variable) -> float:
        """Return the present value of a parameter [SI]."""
        return dict(self.now.values).get(variable.name, variable.usual)

    def open(self, template: StageTemplate) -> None:
        """Open another design or file."""
        self.show(Variant(template))
        self.commit()

    def show(self, variant: Variant) -> None:
        """Show a variant while it is being changed."""
        self.now = variant

    def commit(self) -> None:
        """End a change: from now on it can be undone."""
        self.history.put(self.now)

    def undo(self) -> None:
        """Go back to the variant before."""
        self.commit()
        self.history.undo()
        self.now = self.history.now

    def redo(self) -> None:
        """Take back the last undo."""
        self.history.redo()
        self.now = self.history.now


@lru_cache(maxsize=64)
def _variables(template: StageTemplate) -> tuple[Variable, ...]:
    return every_variable(template, SHARE)
