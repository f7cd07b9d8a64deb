"""What a person has filled in at the bench; a reload finds it again."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from flexstage.web.bench.link import BenchLink

if TYPE_CHECKING:
    from flexstage.web.page import Page

#: The instrument that a new page offers: it needs nothing of one's own.
FIRST_ADDRESS = "twin://?seed=1"


@dataclass
class BenchForms:
    """The fields of one browser."""

    address: str = FIRST_ADDRESS
    """Address of the instrument."""
    leads_to_safe: bool = False
    """Whether drives are led to their safe voltages when the link is ended."""
    operator: str = ""
    """Who works; others see it, and records hold it."""
    name: str = ""
    """What the next run is called."""
    note: str = ""
    """What records say beside it."""
    steps: dict[str, float] = field(default_factory=dict)
    """Step of each axis and quantity, in the unit that is shown."""
    tab: str = "Waveform"
    """What is open of the runs."""
    axis: str = ""
    """Axis of a waveform."""
    shape: str = "cosine"
    """Its shape."""
    ends: dict[str, tuple[float, float]] = field(default_factory=dict)
    """Its low and high end by axis and quantity [V, m]."""
    rate_hz: float | None = 1.0
    """Its cycles in a second [Hz]."""
    cycles: float | None = 3
    """How many."""
    file: str = ""
    """The record that is run as a waveform."""
    sample_rate_hz: float | None = 1000.0
    """Samples of a record in a second [Hz]."""
    duration: float | None = 10.0
    """How long a record takes [s]."""
    plan: str = ""
    """Plan file, or name of a built-in plan."""
    only: tuple[str, ...] = ()
    """Steps of the plan that are wanted; none for all."""


def bench_of(page: "Page") -> BenchLink:
    """Return the bench that all browsers share."""
    panel = page.panel
    return panel.state(BenchLink, lambda: BenchLink(panel.emergency_stop, panel.jobs))


def person(page: "Page") -> str:
    """Return by which name others see who looks at a page."""
    name = page.session.state(BenchForms).operator.strip()
    return name or f"browser {page.session.id[:4]}"


def kept(
    element: Any, forms: BenchForms, name: str, then: Callable[[], object] | None = None
) -> Any:
    """Show a field of the forms in an element, and keep what is filled in."""
    element.value = getattr(forms, name)

    def changed(event: Any) -> None:
        setattr(forms, name, event.value)
        if then is not None:
            then()

    element.on_value_change(changed)
    return element
