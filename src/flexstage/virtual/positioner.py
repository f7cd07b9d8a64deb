"""A stage on a table that carries a scale, simulated: stroke, hysteresis, steps, mounting."""

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from flexstage.base.arrays import Array
from flexstage.base.errors import ModelError
from flexstage.centring.move import Positioner, PositionerAxis
from flexstage.stage import PiezoStack, Screw, Stage
from flexstage.stage.assumptions import CONVERTER_BITS, POSITION_NOISE, SETTLING, VOLTAGE_RANGE
from flexstage.virtual.as_built import loop_share, platform_stroke
from flexstage.virtual.imperfections import require_size
from flexstage.virtual.stack import virtual_stack

if TYPE_CHECKING:
    from flexstage.hysteresis import HysteresisModel

#: How far the slope of a move is from that of the whole loop, over the width of the loop [1].
_SLOPE_SPREAD = 1.6


class VirtualAxis(PositionerAxis):
    """An axis that is moved from command to command.

    The motion of a piezo is in proportion to the free displacement of its `stack` over the range of
    `voltage`; without a stack the axis follows its commands.
    """

    def __init__(
        self,
        name: str,
        stroke: float,
        quantum: float,
        resolution: float,
        *,
        stack: "HysteresisModel | None" = None,
        voltage: tuple[float, float] = VOLTAGE_RANGE,
        backlash: float = 0.0,
        hysteresis: float = 0.0,
    ) -> None:
        if not 0.0 < stroke < math.inf:
            raise ModelError(f"the stroke of axis '{name}' must be positive, got {stroke!r} m")
        if not (0.0 <= quantum < stroke and 0.0 <= backlash < stroke):
            raise ModelError(
                f"step and backlash of axis '{name}' must be 0 or more and less than its stroke, "
                f"got {quantum!r} and {backlash!r} m"
            )
        super().__init__(
            name=name,
            half=0.5 * stroke,
            quantum=quantum,
            resolution=resolution,
            hysteresis=hysteresis,
            backlash=backlash,
        )
        self._stack = stack
        self._voltage = voltage
        self._play = 0.0
        if stack is not None:
            low, high = voltage
            # two whole cycles, as a stage is exercised before use; it comes to rest at the low end
            before = stack.simulate([high, low, high, low])
            self._state = before.state
            ends = before.values[2:]
            self._zero, self._gain = float(ends.mean()), stroke / float(ends[0] - ends[1])

    def move(self, command: float) -> float:
        """Move to a command that can be set, on a straight ramp; return the displacement [m]."""
        if self._stack is None:
            half = 0.5 * self.backlash
            self._play = max(command - half, min(command + half, self._play))
            return self._play
        low, high = self._voltage
        volts = 0.5 * (low + high) + 0.5 * (high - low) * command / self.half
        self._state, free = self._stack.step(self._state, volts)
        return self._gain * (free - self._zero)


def _open_loop_axis(
    stage: Stage, axis: str, quantum: float | None, backlash: float, noise: float
) -> VirtualAxis:
    """An axis that is commanded by its drive, without a sensor."""
    drive = stage.drive_of(axis)
    stroke = _stroke(stage, axis)
    if isinstance(drive, Screw):
        step = drive.smallest_step * stroke / drive.travel if quantum is None else quantum
        return VirtualAxis(axis, stroke, step, noise, backlash=backlash)
    if not isinstance(drive, PiezoStack):
        raise ModelError(
            f"axis '{axis}' of {stage.name} must be driven by a screw or a piezo stack to be "
            f"simulated, got {drive.kind}"
        )
    if backlash:
        raise ModelError("a piezo stack has hysteresis and no backlash: leave the backlash out")
    share = loop_share(stage, axis, stroke)
    voltage = VOLTAGE_RANGE if drive.voltage_range is None else drive.voltage_range
    return VirtualAxis(
        axis,
        stroke,
        stroke / 2**CONVERTER_BITS if quantum is None else quantum,
        noise,
        stack=virtual_stack(voltage, drive.free_stroke, share),
        voltage=voltage,
        hysteresis=_SLOPE_SPREAD * share,
    )


def _stroke(stage: Stage, axis: str) -> float:
    stroke = platform_stroke(stage, axis)
    if stroke is None:
        raise ModelError(
            f"the drive of axis '{axis}' of {stage.name} has no stroke: it cannot be simulated"
        )
    return stroke


@dataclass(frozen=True, slots=True, kw_only=True)
class TableMounting:
    """How a stage stands on the table, and how square its axes are."""

    angle: float = 0.0
    """Angle of the stage on the table, mu [rad]."""
    mirrored: bool = False
    """Whether its y axis counts the other way."""
    squareness: float = 0.0
    """By how much the angle between the axes falls short of square, sigma [rad]."""
    cross_coupling: tuple[float, float] = (0.0, 0.0)
    """Motion in y for that of the x drive, c_yx, and in x for that of the y drive, c_xy [1]."""

    @property
    def matrix(self) -> Array:
        """How a scale moves with the axes, shape (2, 2)."""
        c, s = math.cos(self.angle), math.sin(self.angle)
        own = np.array(
            [
                [1.0, math.sin(self.squareness) + self.cross_coupling[1]],
                [self.cross_coupling[0], math.cos(self.squareness)],
            ]
        )
        sign = np.diag([1.0, -1.0 if self.mirrored else 1.0])
        return np.array([[c, -s], [s, c]]) @ sign @ own


class VirtualPositioner(Positioner):
    r"""A stage on the table, simulated: its stroke, hysteresis, steps and mounting.

    A command is in metres from the middle of the stroke. The axes answer one by one,
    (a, b) = (f_x(x), f_y(y)), and carry the scale by

    .. math:: p = R(\mu) \begin{pmatrix} 1 & 0 \\ 0 & \pm 1 \end{pmatrix}
              \left(\begin{pmatrix} 1 & \sin\sigma \\ 0 & \cos\sigma \end{pmatrix}
              + \begin{pmatrix} 0 & c_{xy} \\ c_{yx} & 0 \end{pmatrix}\right)
              \begin{pmatrix} a \\ b \end{pmatrix}

    in the frame that turns with the table.

    Parameters
    ----------
    stage : Stage
        The stage, of two axes. Its strokes, and the widths of its loops, are those that were
        measured of it where they are published, else those of the lumped model and usual ones.
    mode : {"open loop", "closed loop"}
        Whether the axes are commanded by voltage or by a position sensor each.
    start : tuple of float
        Where the axes are at first, as shares of the stroke from -1 to 1.
    mounting : TableMounting
        How it stands on the table, and how square its axes are.
    noise : float
        Standard deviation with which an axis settles [m].
    sensor_noise : float
        Standard deviation of a sensor's reading when the loop settles [m]; for the closed loop.
    quantum : float, optional
        Step of the commands [m]; by default a 16-bit converter's over the stroke, and the smallest
        step of a screw times the ratio.
    backlash : float
        Play of a screw on turning back, at the scale [m].
    seed : int
        Seed of noise.

    Validity
    --------
    Quasi-static: each command is held until creep and drift have gone. The axes share no
    hysteresis, and a sensor of the closed loop is linear. It is a simulation, no measurement.

    Raises
    ------
    ModelError
        The stage has no two axes, an axis has no stroke, or a figure is impossible.

    Examples
    --------
    >>> from flexstage.stage.designs import design
    >>> stage = VirtualPositioner(design("vgtu-piezo"), mounting=TableMounting(angle=0.4))
    >>> low, high = stage.limits[0]
    >>> print(f"{1e6 * (high - low):.2f} um")
    63.12 um
    >>> before = stage.true_position
    >>> _ = stage.move_to(10e-6, 0.0)
    >>> print(f"{1e6 * np.hypot(*(stage.true_position - before)):.1f} um")
    10.9 um
    """

    def __init__(
        self,
        stage: Stage,
        *,
        mode: Literal["open loop", "closed loop"] = "open loop",
        start: tuple[float, float] = (0.0, 0.0),
        mounting: TableMounting = TableMounting(),
        noise: float = SETTLING,
        sensor_noise: float = POSITION_NOISE,
        quantum: float | None = None,
        backlash: float = 0.0,
        seed: int = 0,
    ) -> None:
        if mode not in ("open loop", "closed loop"):
            raise ModelError(f"the mode is 'open loop' or 'closed loop', got '{mode}'")
        if len(stage.axes) != 2:
            raise ModelError(
                f"a scale is centred by a stage of two axes, got {len(stage.axes)} of {stage.name}"
            )
        for what, value in (("noise", noise), ("sensor noise", sensor_noise)):
            require_size(f"the {what}", value)
        if any(not -1.0 <= share <= 1.0 for share in start):
            raise ModelError(f"the start must be shares of the stroke from -1 to 1, got {start!r}")
        if mode == "open loop":
            self._axes = [
                _open_loop_axis(stage, a.name, quantum, backlash, noise) for a in stage.axes
            ]
        else:
            # a position sensor and a controller make the axes follow their commands
            self._axes = []
            for axis in stage.axes:
                stroke = _stroke(stage, axis.name)
                step = stroke / 2**CONVERTER_BITS if quantum is None else quantum
                settled = math.hypot(noise, sensor_noise)
                self._axes.append(VirtualAxis(axis.name, stroke, step, settled))
        super().__init__(self._axes)
        self._matrix = mounting.matrix
        self._random = np.random.default_rng(seed)
        self.name = f"virtual {stage.name}, {mode}"
        self.move_to(*(share * axis.half for share, axis in zip(start, self._axes, strict=True)))

    @property
    def matrix(self) -> Array:
        """How the scale moves with the axes, hidden from who centres it, shape (2, 2)."""
        return self._matrix.copy()

    @property
    def true_position(self) -> Array:
        """Where the scale is, hidden from who centres it: x and y on the table [m], shape (2,)."""
        return self._true.copy()

    def move_to(self, x: float, y: float) -> tuple[float, float]:
        for axis, u in zip(self._axes, (x, y), strict=True):
            if not abs(u) <= axis.half * (1.0 + 1e-9):
                raise ModelError(
                    f"the command of axis '{axis.name}' must be within {-axis.half:.4g} and "
                    f"{axis.half:.4g} m, got {u!r}"
                )
        return super().move_to(x, y)

    def _go(self, command: tuple[float, float]) -> None:
        reached = [
            axis.move(u) + axis.resolution * self._random.standard_normal()
            for axis, u in zip(self._axes, command, strict=True)
        ]
        self._true: Array = self._matrix @ np.asarray(reached)
