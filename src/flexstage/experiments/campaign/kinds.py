"""Kinds of tests: what each is, what its record holds, and what evaluates it."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from importlib import import_module
from typing import Any

_MOTIONS = ("along", "across", "vertical", "roll", "pitch", "yaw")
_COMMANDED = {"command": "command"}


@dataclass(frozen=True, slots=True, kw_only=True)
class KindOfTest:
    """A kind of test."""

    what: str
    """What it is."""
    evaluated_by: str
    """The function that evaluates it, with its module beside this one."""
    over: tuple[str, ...] = ("time",)
    """What the rows of its records may follow one another by: time, point, or frequency."""
    sensors: tuple[str, ...] | None = None
    """Roles that sensors have in a plan's record of it; None where a plan cannot make one."""
    needed: tuple[str, ...] = ()
    """Those of them without which it cannot be evaluated."""
    beside: Mapping[str, str] = field(default_factory=dict)
    """Columns that a plan's record has beside its sensors, by their role."""

    @property
    def points(self) -> bool:
        """Whether its rows follow one another by number where the file has no time."""
        return "point" in self.over

    @property
    def evaluate(self) -> Callable[..., Any]:
        """The function that makes a `TestResult` of a test, its records and its campaign."""
        module, _, name = self.evaluated_by.partition(".")
        return getattr(import_module(f"flexstage.experiments.campaign.{module}"), name)


#: Kinds of tests by name; a new one is one entry here, and the function that evaluates it.
KINDS: dict[str, KindOfTest] = {
    "motion": KindOfTest(
        what="cycles over the stroke: stroke, hysteresis, straightness, rotations, coupling",
        evaluated_by="motion.evaluate_motion",
        sensors=_MOTIONS,
        needed=("along",),
        beside=_COMMANDED,
    ),
    "spheres": KindOfTest(
        what="the same by spheres of a plate that a measuring machine probes at stations",
        evaluated_by="motion.evaluate_spheres",
        over=("time", "point"),
    ),
    "positioning": KindOfTest(
        what="targets gone to from both sides: accuracy and repeatability as in ISO 230-2",
        evaluated_by="positioning.evaluate_positioning",
        over=("time", "point"),
        sensors=("along",),
        needed=("along",),
        beside=_COMMANDED,
    ),
    "staircase": KindOfTest(
        what="small steps: resolution",
        evaluated_by="holding.evaluate_staircase",
        sensors=("along",),
        needed=("along",),
        beside=_COMMANDED,
    ),
    "hold": KindOfTest(
        what="the stage held: noise and drift",
        evaluated_by="holding.evaluate_hold",
        sensors=("along",),
        needed=("along",),
    ),
    "response": KindOfTest(
        what="hammer, sweep or noise: natural frequencies and damping",
        evaluated_by="response.evaluate_response",
        over=("time", "frequency"),
        sensors=(),
    ),
    "ring-down": KindOfTest(
        what="free decay: natural frequencies and damping",
        evaluated_by="response.evaluate_ring_down",
    ),
    "workspace": KindOfTest(
        what="corners gone to again and again: area, squareness",
        evaluated_by="motion.evaluate_workspace",
        over=("time", "point"),
        sensors=("x", "y"),
        needed=("x", "y"),
        beside={"corner": "corner"},
    ),
}
