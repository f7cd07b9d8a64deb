"""Blows of a hammer."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

from flexstage.experiments.axis_limits import AxisSetting
from flexstage.experiments.command import BASE_RATE_HZ, Strike
from flexstage.experiments.verb import PlanContext, PlannedStep
from flexstage.experiments.verbs.excite import Excite
from flexstage.files.ranges import Count


@dataclass(frozen=True, slots=True, kw_only=True)
class Blows(Excite):
    """Blows of a hammer along an axis, its drives taken out."""

    kind: ClassVar[str] = "blows"
    response: ClassVar[str] = "hammer"

    axis: str
    """The axis."""
    hits: Count = 5
    """How many."""

    def command(
        self,
        settings: Mapping[str, AxisSetting],
        sample_rate_hz: float,
        *,
        base_rate_hz: float = BASE_RATE_HZ,
    ) -> Strike:
        del settings, sample_rate_hz, base_rate_hz
        return Strike(axis=self.axis, hits=self.hits)

    def preview(self, context: PlanContext, name: str) -> PlannedStep:
        self.settings(context)
        what = f"{self.hits} blows along {self.axis}, drives taken out"
        return PlannedStep(name=name, verb=self.verb, what=what)
