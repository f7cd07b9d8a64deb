"""Form fields of the view Bench in one browser; they survive a reload."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from flexstage.web.bench.link import BenchLink

if TYPE_CHECKING:
    from flexstage.web.page import Page

#: The instrument of a new page: the simulated stage, which needs no hardware.
FIRST_ADDRESS = "twin://?seed=1"


@dataclass
class BenchForms:
    """The form fields of one browser."""

    address: str = FIRST_ADDRESS
    """Address of the instrument."""
    ramps_to_safe: bool = False
    """Ramp the drives to their safe voltages on disconnecting."""
    operator: str = ""
    """Operator, shown to other browsers and written in records."""
    name: str = ""
    """Name of the next run."""
    note: str = ""
    """Note in records."""
    steps: dict[str, float] = field(default_factory=dict)
    """Step of each axis and quantity, in the displayed unit."""
    tab: str = "Waveform"
    """Open tab of the runs."""
    axis: str = ""
    """Axis of the waveform."""
    shape: str = "cosine"
    """Shape of the waveform."""
    ends: dict[str, tuple[float, float]] = field(default_factory=dict)
    """Low and high end of the waveform, by axis and quantity [V, m]."""
    rate_hz: float | None = 1.0
    """Frequency of the waveform [Hz]."""
    cycles: float | None = 3
    """Number of cycles."""
    file: str = ""
    """File of a waveform from a record."""
    sample_rate_hz: float | None = 1000.0
    """Sample rate of a record [Hz]."""
    duration: float | None = 10.0
    """Duration of a record [s]."""
    plan: str = ""
    """Plan file, or name of a built-in plan."""
    only: tuple[str, ...] = ()
    """Selected steps of the plan; empty for all."""


def bench_of(page: "Page") -> BenchLink:
    """Return the bench, which all browsers share."""
    panel = page.panel
    return panel.state(BenchLink, lambda: BenchLink(panel.emergency_stop, panel.jobs))


def user_name(page: "Page") -> str:
    """Return the name of the user of a page for other browsers."""
    name = page.session.state(BenchForms).operator.strip()
    return name or f"browser {page.session.id[:4]}"


def bind_field(
    element: Any, forms: BenchForms, name: str, on_change: Callable[[], object] | None = None
) -> Any:
    """Bind an element to a field of the forms."""
    element.value = getattr(forms, name)

    def changed(event: Any) -> None:
        setattr(forms, name, event.value)
        if on_change is not None:
            on_change()

    element.on_value_change(changed)
    return element
