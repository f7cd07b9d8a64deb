"""What moves the scale on the table: two axes with limits, a resolution and perhaps hysteresis."""

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(kw_only=True)
class PositionerAxis:
    """One of the two axes, commanded in metres from the middle of its stroke."""

    name: str
    """Its name."""
    half: float
    """Half of its stroke, the largest command to either side [m]."""
    quantum: float = 0.0
    """Step of its commands [m]; 0 for none."""
    resolution: float = 0.0
    """Standard uncertainty with which it takes a command that can be set [m]."""
    hysteresis: float = 0.0
    """Standard uncertainty of a move as a share of its length [1]."""
    backlash: float = 0.0
    """Play on turning back, at the scale [m]."""

    def settable(self, command: float) -> float:
        """Return the nearest command within the stroke that can be set [m]."""
        inside = min(max(command, -self.half), self.half)
        if self.quantum == 0.0:
            return inside
        steps = round(inside / self.quantum)
        # the last step before the end, where the end itself is none
        most = math.floor(self.half / self.quantum * (1.0 + 1e-12))
        return min(max(steps, -most), most) * self.quantum


class Positioner(ABC):
    """Two axes that carry the scale, as the one who centres it sees them.

    Where the scale really goes is not known to it: the axes may be turned on the table by any
    angle, count the other way, differ in gain and not be square.
    """

    def __init__(self, axes: Sequence[PositionerAxis]) -> None:
        self._x, self._y = axes
        self._position = (0.0, 0.0)

    @property
    def limits(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """Least and greatest command of each axis [m]."""
        return (-self._x.half, self._x.half), (-self._y.half, self._y.half)

    @property
    def position(self) -> tuple[float, float]:
        """The last command, as it was set [m]."""
        return self._position

    @property
    def resolution(self) -> tuple[float, float]:
        """Standard uncertainty with which an axis takes a command, for short moves [m]."""
        return self._x.resolution, self._y.resolution

    @property
    def hysteresis(self) -> tuple[float, float]:
        """Standard uncertainty of a move as a share of its length, of each axis [1]."""
        return self._x.hysteresis, self._y.hysteresis

    @property
    def backlash(self) -> tuple[float, float]:
        """Play of each axis on turning back, at the scale [m]."""
        return self._x.backlash, self._y.backlash

    def settable(self, x: float, y: float) -> tuple[float, float]:
        """Return the nearest commands within the limits that can be set [m]."""
        return self._x.settable(x), self._y.settable(y)

    def move_to(self, x: float, y: float) -> tuple[float, float]:
        """Move both axes to commands [m]; return what was set."""
        self._position = self.settable(x, y)
        self._go(self._position)
        return self._position

    @abstractmethod
    def _go(self, command: tuple[float, float]) -> None:
        """Move both axes to commands that can be set [m]."""
