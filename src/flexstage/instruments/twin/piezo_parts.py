"""What a simulated piezo stage is made of, and the numbers of its loop."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from flexstage.arrays import Array
from flexstage.errors import ModelError
from flexstage.experiment.virtual.imperfections import GuideErrors
from flexstage.hysteresis.chain.modal import unit_step
from flexstage.hysteresis.virtual_stack import VirtualStack
from flexstage.instruments.limits import AxisLimits
from flexstage.instruments.servo import ServoSettings
from flexstage.instruments.twin.loop import DriveArrays, ModeArrays
from flexstage.system import MechanicalSystem, modes

_CONVERTER_BITS = 20


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PiezoAxis:
    """One axis of a piezo stage as it was made."""

    name: str
    """Name of the axis."""
    drive: str
    """Name of the drive of its system."""
    probe: str
    """Name of the probe of its system."""
    stack: VirtualStack
    """From voltage to free displacement."""
    limits: AxisLimits
    """What may be commanded; its voltage range is that of the amplifier."""
    largest_rate: float = float("inf")
    """Largest rate of the amplifier on its stack [V/s]; infinite for none."""
    guide: GuideErrors | None = None
    """What its guide does beside it; nothing where not given."""
    low: float = 0.0
    """Position of the low end of its stroke [m], at which the guide's curves begin."""
    settings: ServoSettings = field(default_factory=ServoSettings)
    """Settings of its control as delivered."""


def commands(command: ArrayLike, axes: int) -> Array:
    """Return a copy of commands as a loop takes them, shape (axes, n)."""
    given = np.array(command, dtype=np.float64, order="C")
    if given.ndim != 2 or given.shape[0] != axes:
        raise ModelError(f"a command of {axes} axes has the shape ({axes}, n), got {given.shape}")
    if not np.all(np.isfinite(given)):
        a, k = np.argwhere(~np.isfinite(given))[0]
        raise ModelError(f"the command of axis {a} is {given[a, k]} at sample {k}: not finite")
    return given


def drive_arrays(
    parts: Sequence[PiezoAxis], sample_rate_hz: float, bandwidth_hz: float, *, quiet: bool
) -> DriveArrays:
    """Return converters and amplifiers as the loop takes them."""
    converter, amplifier = [], []
    time = 1.0 / (2.0 * np.pi * bandwidth_hz)
    for part in parts:
        if part.limits.voltage is None:
            raise ModelError(f"axis '{part.name}' needs a voltage range: give it in its limits")
        low, high = part.limits.voltage
        converter.append((low, high, 0.0 if quiet else (high - low) / (2**_CONVERTER_BITS - 1)))
        amplifier.append((1.0 / (sample_rate_hz * time), part.largest_rate * time))
    return DriveArrays(converter=np.array(converter), amplifier=np.array(amplifier))


def mode_arrays(
    system: MechanicalSystem, parts: Sequence[PiezoAxis], sample_rate_hz: float
) -> ModeArrays:
    """Return the modes of a stage with its stacks in place as the loop takes them.

    A few empty ones follow, so that they are a multiple of 4.
    """
    found = modes(system, drives="in place", count=None)
    force, reader = [], []
    for part in parts:
        port = system.drive(part.drive)
        if not port.stiffness:
            raise ModelError(f"drive '{part.drive}' needs the stiffness of a stack")
        force.append(port.stiffness * (port.vector @ found.shapes) / found.omega**2)
        reader.append(system.probe(part.probe).vector @ found.shapes)
    step = unit_step(found.omega / sample_rate_hz, np.asarray(found.damping_ratio))
    # by fours, as they are summed
    more = (0, -found.omega.size % 4)
    return ModeArrays(
        force=np.pad(np.array(force), ((0, 0), more)),
        transition=np.pad(step.transition, ((0, 0), more)),
        moments=np.pad(step.moments[:3], ((0, 0), more)),
        reader=np.pad(np.array(reader), ((0, 0), more)),
    )
