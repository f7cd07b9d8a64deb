"""Stacks of a stage at work: their working lines, and what their amplifiers give."""

import math
from dataclasses import dataclass, replace
from typing import Any

from flexstage.base.errors import ModelError
from flexstage.stage.assumptions import AMPLIFIER_CURRENT, VOLTAGE_RANGE
from flexstage.stage.drive import Drive, PiezoStack
from flexstage.stage.model import Stage
from flexstage.stage.stack_supply import StackSupply
from flexstage.studies.requests import StackOptions
from flexstage.system import Analysis
from flexstage.system.characteristics import axis_mode
from flexstage.system.seated_drives import WorkingLine, working_lines


@dataclass(frozen=True, slots=True, kw_only=True)
class StackAtWork:
    """A stack on its stage, with its supply."""

    line: WorkingLine
    """Its working line."""
    supply: StackSupply | None
    """What its amplifier gives; None without a capacitance."""

    def data(self) -> dict[str, Any]:
        """Return both as plain data."""
        supply = None if self.supply is None else self.supply.data()
        return {"working_line": self.line.data(), "supply": supply}


def stacks_at_work(analysis: Analysis, options: StackOptions) -> tuple[StackAtWork, ...]:
    """Return each stack of an analysed stage at work; none without a rate.

    Raises
    ------
    ModelError
        The stage has no stack, two drives are redundant, or an axis has no natural frequency.
    """
    if options.rate is None:
        return ()
    lines = working_lines(analysis.stage, analysis.system)
    if not lines:
        raise ModelError("--rate is for piezo stacks, which the stage does not have: omit it")
    return tuple(
        StackAtWork(line=line, supply=stack_supply(line.drive, rate, options))
        for line in lines
        for rate in (_rate(analysis, line, options),)
    )


def heated_by_stacks(stage: Stage, options: StackOptions) -> Stage:
    """Return the stage whose stacks with heat but without power have that of a rate.

    Raises
    ------
    ModelError
        The rate is natural, which is known only after the analysis.
    """
    drives: list[Drive] = []
    lossy = options.rate is not None and options.loss_factor is not None
    for drive in stage.drives:
        if lossy and isinstance(drive, PiezoStack) and drive.heat and drive.heat.power is None:
            if not isinstance(options.rate, int | float):
                raise ModelError(
                    f"the heat of stack '{drive.name}' in time needs --rate in Hz, got natural"
                )
            supply = stack_supply(drive, float(options.rate), options)
            power = None if supply is None else supply.heat
            drives.append(replace(drive, heat=replace(drive.heat, power=power)))
        else:
            drives.append(drive)
    return replace(stage, drives=tuple(drives))


def stack_supply(drive: PiezoStack, rate: float, options: StackOptions) -> StackSupply | None:
    """Return what the amplifier of a stack gives at a rate [Hz]; None without a capacitance."""
    amplifier = options.amplifier
    capacitance = amplifier.capacitance or drive.capacitance
    if capacitance is None:
        return None
    low, high = drive.voltage_range or VOLTAGE_RANGE
    lowest, highest = options.voltage or (low, high)
    if not low <= lowest < highest <= high:
        raise ModelError(
            f"--voltage {lowest:g}:{highest:g} must rise within the range {low:g}:{high:g} V of "
            f"the stack '{drive.name}'"
        )
    return StackSupply(
        capacitance=capacitance,
        voltage=highest - lowest,
        rate=rate,
        voltage_span=high - low,
        largest_current=amplifier.current or AMPLIFIER_CURRENT,
        largest_slew=amplifier.slew or drive.largest_slew or math.inf,
        loss_factor=options.loss_factor,
        thermal_resistance=options.thermal_resistance,
    )


def _rate(analysis: Analysis, line: WorkingLine, options: StackOptions) -> float:
    """Return the rate: that given, or the lowest frequency of its axes with the drives in place."""
    if isinstance(options.rate, int | float):
        return float(options.rate)
    modes = analysis.modes["in place"]
    frequencies = [
        float(modes.frequency_hz[axis_mode(analysis.system, modes, a.static.drive_force, a.probe)])
        for a in analysis.axes
        if line.drive.name in a.drives
    ]
    if frequencies:
        return min(frequencies)
    raise ModelError(
        f"the stack '{line.drive.name}' drives no axis with a natural frequency: give --rate in Hz"
    )
