"""Blows of a hammer on a simulated stage, its drives taken out."""

from flexstage.choose import has_no
from flexstage.errors import ModelError
from flexstage.experiment.virtual.as_built import AsBuilt
from flexstage.experiment.virtual.bench import HammerBench, Laboratory
from flexstage.instruments.twin.stage import Blow


class Hammer:
    """A hammer with a force sensor, and an accelerometer on the platform."""

    def __init__(self, built: AsBuilt, seed: int) -> None:
        self._bench = HammerBench(built, Laboratory(hits=1))
        self._axes = [a.name for a in built.axes]
        self._seed, self._struck = seed, 0

    def strike(self, axis: str) -> Blow:
        """Strike once along an axis; the next blow differs from it."""
        if axis not in self._axes:
            raise ModelError(has_no("the stage", "axis", axis, self._axes))
        # each blow has a seed of its own, far from those of other stages
        record = self._bench.record(axis, seed=1_000_003 * (self._seed + 1) + self._struck)
        self._struck += 1
        time = record.time
        return Blow(
            time=time,
            force=record.channel("force").values,
            response=record.channel(f"acceleration {axis}").values,
            sample_rate_hz=float(1.0 / (time[1] - time[0])),
        )

    def reset(self) -> None:
        """Begin with the first blow again."""
        self._struck = 0
