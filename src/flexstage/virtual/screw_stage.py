"""A simulated stage driven by adjustment screws."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from flexstage.base.arrays import Array
from flexstage.hysteresis.compiled import compiled
from flexstage.stage import Stage
from flexstage.stage.limits import AxisLimits
from flexstage.virtual.imperfections import GuideErrors
from flexstage.virtual.sensors import (
    neighbour,
    polynomial,
    readings_beside,
    sources,
)
from flexstage.virtual.stage import Conditions, StageSamples, VirtualStage, commands


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ScrewAxis:
    """One axis of a screw-driven stage as it was made."""

    name: str
    """Name of the axis."""
    limits: AxisLimits
    """Range and largest speed of the advance of the screw."""
    smallest_step: float
    """Smallest step of the advance [m]."""
    backlash: float
    """By how much the screw turns back before the stage follows, as its advance [m]."""
    ratio: float
    """Motion of the platform over that of the screw [1]."""
    guide: GuideErrors
    """What its guide does beside it, and what the position is off by."""

    @property
    def low(self) -> float:
        """Position of the low end of the stroke, once the backlash has been gone through [m]."""
        return 0.5 * self.backlash * self.ratio


class ScrewStage(VirtualStage):
    """A screw-driven stage sample by sample, as `VirtualStage` says.

    A screw turns towards what is commanded, in whole steps and no faster than it may; the stage
    follows behind its backlash. It has no position control: its position is the advance of the
    screw.

    Notes
    -----
    Validity: at rest at every instant, since a screw is slow beside the modes of its stage; the
    backlash is the same everywhere, and the error of the thread is left out.
    """

    kind = "screw"

    def __init__(self, *, stage: Stage, axes: Sequence[ScrewAxis], conditions: Conditions) -> None:
        super().__init__(stage, {a.name: a.limits for a in axes}, conditions)
        #: What drives and guides each axis.
        self.parts = tuple(axes)
        names = self.axes
        self._source, self._rows = sources(
            names, {a.name: a.guide for a in axes}, {a.name: a.low for a in axes}
        )
        self._screws = np.array(
            [
                (a.smallest_step, (a.limits.speed or np.inf) / self.sample_rate_hz,
                 0.5 * a.backlash, a.ratio, *(a.limits.position or (-np.inf, np.inf)))
                for a in axes
            ]
        )  # fmt: skip
        self._curves = np.zeros((len(names), len(names), 6))
        for s, part in enumerate(axes):
            self._curves[s, s] = polynomial(part.guide, "along", part.low)
            other = neighbour(names, part.name)
            if other is not None:
                self._curves[names.index(other), s] = polynomial(part.guide, "across", part.low)
        self.reset()

    def run(
        self, command: Array, servo: Sequence[bool], feedforward: Array | None = None
    ) -> StageSamples:
        del servo, feedforward
        axes = len(self.parts)
        wanted = commands(command, axes)
        n = wanted.shape[1]
        advance, own, position = (np.empty((axes, n)) for _ in range(3))
        _turn(self._screws, self._state, wanted, advance, own)
        reading = np.empty((len(self.channels), n))
        drift, noise = self._disturbances.take(self._count, n)
        d = self._disturbances
        _read(self._curves, own, drift, noise, d.gain, d.step, position, reading)
        readings_beside(self._source, self._rows, position, drift, noise, d.gain, d.step, reading)
        time = (self._count + np.arange(n)) / self.sample_rate_hz
        self._count += n
        return StageSamples(
            time=time, reading=reading, position=position, voltage=np.zeros((axes, n)),
            command=advance,
        )  # fmt: skip

    def reset(self) -> None:
        """Turn the screws back, and begin at time 0 with the same noise."""
        self._count = 0
        self._disturbances = self.conditions.disturbances(self.channels)
        #: advance of each screw [m], and what the stage follows behind its backlash [m]
        self._state = np.zeros((len(self.parts), 2))
        if self.conditions.hammer is not None:
            self.conditions.hammer.reset()


@compiled
def _turn(screws: Array, state: Array, wanted: Array, advance: Array, own: Array) -> None:
    """Turn screws in whole steps, at a limited speed, and let the stage follow by a play."""
    for a in range(wanted.shape[0]):
        step, fastest, half, ratio, low, high = screws[a]
        at, follows = state[a]
        for k in range(wanted.shape[1]):
            goal = min(max(step * np.round(wanted[a, k] / step), low), high)
            at += min(max(goal - at, -fastest), fastest)
            follows = max(at - half, min(at + half, follows))
            advance[a, k] = at
            own[a, k] = ratio * follows
        state[a, 0], state[a, 1] = at, follows


@compiled
def _read(
    curves: Array,
    own: Array,
    drift: Array,
    noise: Array,
    gain: Array,
    step: Array,
    position: Array,
    reading: Array,
) -> None:
    """Add what the guides do, and read along the axes."""
    axes, n = own.shape
    for a in range(axes):
        for k in range(n):
            at = own[a, k] + drift[a, k]
            for s in range(axes):
                c, x = curves[a, s], own[s, k]
                value = c[5]
                for i in range(4, -1, -1):
                    value = value * x + c[i]
                at += value
            position[a, k] = at
            seen = gain[a] * at + noise[a, k]
            if step[a] > 0.0:
                seen = step[a] * np.round(seen / step[a])
            reading[a, k] = seen
