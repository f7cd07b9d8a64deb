"""A stage in time whose every sample has a closed form: for tests of what controls one."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from flexstage.base.arrays import Array
from flexstage.base.errors import ModelError
from flexstage.stage.designs import design
from flexstage.stage.limits import AxisLimits
from flexstage.system.servo import ServoSettings
from flexstage.virtual.laboratory import HammerImpact
from flexstage.virtual.sensors import ChannelDescription
from flexstage.virtual.stage import StageSamples, VirtualStage

GAIN = np.array([4.7e-7, 3.9e-7])  # m/V
POLE = np.array([0.62, 0.71])  # of the first-order lag, a sample
ACROSS = 0.013  # x.across over x
REDUCTION = 0.037  # platform over screw
STEP = 0.5e-6  # of a screw
RANGE = (-7.0, 113.0)
PIEZO = AxisLimits(position=(0.4e-6, 41e-6), voltage=RANGE, slew=3e4)
SCREW = AxisLimits(position=(0.0, 2.3e-3), speed=1.1e-3)


@dataclass
class SimpleStage(VirtualStage):
    """First-order lags without noise; `commands` and `beside` keep what came, sample by sample."""

    kind: Literal["piezo", "screw"] = "piezo"
    sample_rate_hz: float = 1e4

    def __post_init__(self) -> None:
        self.stage = design("vgtu-piezo" if self.kind == "piezo" else "vgtu-mechanical")
        self.axes = ("x", "y")
        names = ("x", "y", "x.across")
        self.channels = tuple(
            ChannelDescription(number=i + 1, name=n, unit="m") for i, n in enumerate(names)
        )
        self.limits = dict.fromkeys(self.axes, PIEZO if self.kind == "piezo" else SCREW)
        self.notes = ()
        self._settings: dict[str, ServoSettings] = dict.fromkeys(
            self.axes, ServoSettings(integral=6e8)
        )
        self.reset()

    def reset(self) -> None:
        self.position, self.volts = np.zeros(2), np.zeros(2)
        self._beside = np.full(2, np.nan)
        self.commands = np.zeros((2, 0))
        self.beside = np.zeros((2, 0))
        self.samples = 0

    def servo_settings(self, axis: str) -> ServoSettings:
        if self.kind == "screw":
            raise ModelError("a screw has no servo")
        return self._settings[axis]

    def set_servo_settings(self, axis: str, settings: ServoSettings) -> None:
        self._settings[axis] = settings

    def run(
        self, command: Array, servo: Sequence[bool], feedforward: Array | None = None
    ) -> StageSamples:
        n = command.shape[1]
        beside = np.full((2, n), np.nan) if feedforward is None else feedforward
        self.commands = np.hstack((self.commands, command))
        self.beside = np.hstack((self.beside, beside))
        time = (self.samples + np.arange(n)) / self.sample_rate_hz
        self.samples += n
        if self.kind == "screw":
            assert not any(servo)
            advance = np.round(command / STEP) * STEP
            reading = np.vstack((REDUCTION * advance, ACROSS * REDUCTION * advance[:1]))
            return StageSamples(
                time=time, reading=reading, position=reading[:2], voltage=0.0 * advance,
                command=advance,
            )  # fmt: skip
        position, volts = np.empty((2, n)), np.empty((2, n))
        for k in range(n):
            for i, axis in enumerate(self.axes):
                u = command[i, k]
                if servo[i]:
                    extra, before = beside[i, k], self._beside[i]
                    taken = np.isnan(extra) != np.isnan(before)  # the integral takes it over
                    integral = self.volts[i] - np.nan_to_num(extra if taken else before)
                    ki = self._settings[axis].integral / self.sample_rate_hz
                    u = np.nan_to_num(extra) + integral + ki * (u - self.position[i])
                self._beside[i] = beside[i, k] if servo[i] else np.nan
                self.volts[i] = min(max(u, RANGE[0]), RANGE[1])
                share = 1.0 - POLE[i]
                self.position[i] += share * (GAIN[i] * self.volts[i] - self.position[i])
            position[:, k], volts[:, k] = self.position, self.volts
        reading = np.vstack((position, ACROSS * position[:1]))
        return StageSamples(
            time=time, reading=reading, position=position, voltage=volts, command=volts
        )

    def strike(self, axis: str) -> HammerImpact:
        rate = 8192.0
        time = np.arange(4096) / rate
        force = pulse(time - 0.051, 9.0)
        return HammerImpact(time=time, force=force, response=ring(time, axis), sample_rate_hz=rate)


def pulse(since: Array, height: float) -> Array:
    """A smooth blow around 0, as good as nothing above 3 kHz."""
    return height * np.exp(-0.5 * (since / 0.3e-3) ** 2)


def ring(time: Array, axis: str) -> Array:
    """A band-limited answer that has died out at both ends."""
    f = {"x": 311.0, "y": 402.0}[axis]
    return 3.1 * np.exp(-0.5 * ((time - 0.2) / 0.02) ** 2) * np.cos(2 * np.pi * f * time)
