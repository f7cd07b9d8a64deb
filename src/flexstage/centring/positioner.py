"""What moves the scale on the table: two axes with limits, a resolution and perhaps hysteresis."""

import math
from typing import Literal, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike

from flexstage.arrays import Array
from flexstage.centring.virtual_axis import VirtualAxis, closed_loop_axis, open_loop_axis
from flexstage.errors import ModelError
from flexstage.stage import Stage


@runtime_checkable
class Positioner(Protocol):
    """Two axes that carry the scale, as the one who centres it sees them.

    Where the scale really goes is not known to it: the axes may be turned on the table by any
    angle, count the other way, differ in gain and not be square.
    """

    @property
    def limits(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """Least and greatest command of each axis [m]."""
        ...

    @property
    def position(self) -> tuple[float, float]:
        """The last command, as it was set [m]."""
        ...

    @property
    def resolution(self) -> tuple[float, float]:
        """Standard uncertainty with which an axis takes a command, for short moves [m]."""
        ...

    @property
    def hysteresis(self) -> tuple[float, float]:
        """Standard uncertainty of a move as a share of its length, of each axis [1]."""
        ...

    @property
    def backlash(self) -> tuple[float, float]:
        """Play of each axis on turning back, at the scale [m]."""
        ...

    def settable(self, x: float, y: float) -> tuple[float, float]:
        """Return the nearest commands within the limits that can be set.

        Parameters
        ----------
        x, y : float
            Commands [m].

        Returns
        -------
        tuple of float
            What would be set [m].
        """
        ...

    def move_to(self, x: float, y: float) -> tuple[float, float]:
        """Move both axes.

        Parameters
        ----------
        x, y : float
            Commands [m].

        Returns
        -------
        tuple of float
            What was set [m].
        """
        ...


class VirtualPositioner:
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
    mounting_angle : float
        Angle of the stage on the table, mu [rad].
    mirrored : bool
        Whether its y axis counts the other way.
    squareness : float
        By how much the angle between the axes falls short of square, sigma [rad].
    cross_coupling : tuple of float
        Motion in y for that of the x drive, c_yx, and in x for that of the y drive, c_xy [1].
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
    >>> from flexstage.designs import design
    >>> stage = VirtualPositioner(design("vgtu-piezo"), mounting_angle=0.4)
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
        mounting_angle: float = 0.0,
        mirrored: bool = False,
        squareness: float = 0.0,
        cross_coupling: tuple[float, float] = (0.0, 0.0),
        noise: float = 2e-9,
        sensor_noise: float = 5e-9,
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
            if not 0.0 <= value < math.inf:
                raise ModelError(f"the {what} must be 0 or more and finite, got {value!r} m")
        if any(not -1.0 <= share <= 1.0 for share in start):
            raise ModelError(f"the start must be shares of the stroke from -1 to 1, got {start!r}")
        if mode == "open loop":
            axes = [open_loop_axis(stage, a.name, quantum, backlash) for a in stage.axes]
            self._noise = noise
        else:
            axes = [closed_loop_axis(stage, a.name, quantum) for a in stage.axes]
            self._noise = math.hypot(noise, sensor_noise)
        self._axes: tuple[VirtualAxis, VirtualAxis] = (axes[0], axes[1])
        c, s = math.cos(mounting_angle), math.sin(mounting_angle)
        own = np.array(
            [
                [1.0, math.sin(squareness) + cross_coupling[1]],
                [cross_coupling[0], math.cos(squareness)],
            ]
        )
        sign = np.diag([1.0, -1.0 if mirrored else 1.0])
        self._matrix = np.array([[c, -s], [s, c]]) @ sign @ own
        self._random = np.random.default_rng(seed)
        self.name = f"virtual {stage.name}, {mode}"
        self.move_to(*(share * axis.half for share, axis in zip(start, self._axes, strict=True)))

    @property
    def limits(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """Least and greatest command of each axis [m]."""
        x, y = self._axes
        return (-x.half, x.half), (-y.half, y.half)

    @property
    def position(self) -> tuple[float, float]:
        """The last command, as it was set [m]."""
        return self._position

    @property
    def resolution(self) -> tuple[float, float]:
        """Standard uncertainty with which an axis takes a command that can be set [m]."""
        return self._noise, self._noise

    @property
    def hysteresis(self) -> tuple[float, float]:
        """Standard uncertainty of a move as a share of its length, of each axis [1]."""
        return self._axes[0].hysteresis, self._axes[1].hysteresis

    @property
    def backlash(self) -> tuple[float, float]:
        """Play of each axis on turning back, at the scale [m]."""
        return self._axes[0].backlash, self._axes[1].backlash

    @property
    def matrix(self) -> Array:
        """How the scale moves with the axes, hidden from who centres it, shape (2, 2)."""
        return self._matrix.copy()

    @property
    def true_position(self) -> Array:
        """Where the scale is, hidden from who centres it: x and y on the table [m], shape (2,)."""
        return self._true.copy()

    def settable(self, x: float, y: float) -> tuple[float, float]:
        """Return the nearest commands within the limits that can be set.

        Parameters
        ----------
        x, y : float
            Commands [m].

        Returns
        -------
        tuple of float
            What would be set [m].
        """
        first, second = (a.settable(u) for a, u in zip(self._axes, (x, y), strict=True))
        return first, second

    def move_to(self, x: float, y: float) -> tuple[float, float]:
        """Move both axes, each by a straight ramp.

        Parameters
        ----------
        x, y : float
            Commands [m].

        Returns
        -------
        tuple of float
            What was set [m].

        Raises
        ------
        ModelError
            A command is not finite or not within the limits.
        """
        for axis, u in zip(self._axes, (x, y), strict=True):
            if not abs(u) <= axis.half * (1.0 + 1e-9):
                raise ModelError(
                    f"the command of axis '{axis.name}' must be within {-axis.half:.4g} and "
                    f"{axis.half:.4g} m, got {u!r}"
                )
        self._position = self.settable(x, y)
        reached: ArrayLike = [
            axis.move(u) + self._noise * self._random.standard_normal()
            for axis, u in zip(self._axes, self._position, strict=True)
        ]
        self._true: Array = self._matrix @ np.asarray(reached)
        return self._position
