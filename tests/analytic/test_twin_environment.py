"""The twin in an environment: signals with its densities, and the rms that the budget predicts."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from flexstage.base.errors import ModelError
from flexstage.control.dynamic_budget import PointBudget, dynamic_budget
from flexstage.instruments.pi.simulated.address import open_twin
from flexstage.lumped import lumped_system
from flexstage.stage.designs import design
from flexstage.system import ModalDamping
from flexstage.system.environment import Environment, PositionLoop, environment_from_text
from flexstage.system.servo import Notch, ServoSettings
from flexstage.virtual.build import virtual_stage
from flexstage.virtual.piezo_stage import PiezoStage, stack_of
from flexstage.virtual.sensors import SourceSignals
from tests.twin_parts import SLOPES, STAGE, damped_system, small_stage

RATE = 10e3
#: From a reading to its voltage: two samples, and the lag of the amplifier.
DELAY = 2.0 / RATE + 1.0 / (2.0 * math.pi * 2e3)


def environment(sources: str, band: str = "[1 Hz, 5 kHz]") -> Environment:
    return environment_from_text(f"environment: 1\nname: made\nband: {band}\nsources:\n{sources}")


def spread(budget: PointBudget, duration: float) -> float:
    """Return the relative standard deviation of the rms of a Gaussian record."""
    f, density = budget.frequency_hz, sum(s.density for s in budget.sources)
    return 0.5 * math.sqrt(np.trapezoid(density**2, f) / duration) / np.trapezoid(density, f)


def at_rest(twin: PiezoStage, settings: ServoSettings | None, seconds: float) -> float:
    """Return the rms of x about its mean, after a second: at 0 V, or under control at 60 V."""
    twin.reset()
    voltage = np.full((2, 5000), 0.0 if settings is None else 60.0)
    before = twin.run(voltage, [False, False])
    command = np.repeat(voltage[:, :1], round((seconds + 1.0) * RATE), axis=1)
    if settings is not None:
        twin.set_servo_settings("x", settings)
        command[0] = before.reading[0, -1]
    position = twin.run(command, [settings is not None, False]).position
    return float(position[0, round(RATE) :].std())


def test_drawn_sources_have_their_variance_and_do_not_depend_on_the_blocks() -> None:
    made = environment(
        "  air: {kind: force, body: PY, along: x,"
        " spectrum: {kind: lowpass, rms: 2 mN, bandwidth: 40 Hz}}\n"
        "  floor: {kind: ground, along: x, spectrum: {kind: lines, at: [[50 Hz, 3 nm]]}}\n"
        "  sensor: {kind: sensor, spectrum: {kind: white, level: 1 nm/rtHz, sided: one}}\n",
        band="[20 Hz, 2 kHz]",
    )
    drawn = SourceSignals(made, RATE, 5)
    air, floor, sensor = (drawn.take(k, 0, 200_000) for k in range(3))
    # 2 mN of which 40 Hz and 20 Hz to 2 kHz leave a share; the sinc adds a thousandth
    share = (math.atan(2000.0 / 40.0) - math.atan(20.0 / 40.0)) / (0.5 * math.pi)
    assert air.std() == pytest.approx(2e-3 * math.sqrt(share), rel=0.03)
    assert sensor.std() == pytest.approx(1e-9 * math.sqrt(1980.0), rel=0.01)
    acceleration = 3e-9 * (2.0 * math.pi * 50.0) ** 2
    assert floor.std() == pytest.approx(acceleration / np.sinc(0.005) ** 2, rel=1e-6)
    again = SourceSignals(made, RATE, 5)
    assert np.array_equal(np.concatenate([again.take(0, 0, 7), again.take(0, 7, 3993)]), air[:4000])
    other = drawn.take(2, 0, 200_000, stream=1)
    assert abs(np.corrcoef(sensor, other)[0, 1]) < 0.02


@pytest.mark.parametrize("controlled", [False, True])
def test_a_linear_twin_moves_by_its_budget(controlled: bool) -> None:
    made = environment(
        "  floor: {kind: ground, along: x,"
        " spectrum: {kind: white, level: 4 mm/s^2/rtHz, sided: one}}\n"
        "  air: {kind: force, body: PY, along: x,"
        " spectrum: {kind: white, level: 2 mN/rtHz, sided: one}}\n"
        "  amplifier: {kind: voltage, drive: x,"
        " spectrum: {kind: lowpass, rms: 13 mV, bandwidth: 1 kHz}}\n"
        "  sensor: {kind: sensor, spectrum: {kind: white, level: 1 nm/rtHz, sided: one}}\n"
    )
    settings = ServoSettings(integral=1.2e9, lowpass_hz=1100.0)
    loop = PositionLoop(name="loop", settings=settings, delay=DELAY)
    system = damped_system()
    # the stack of this twin has a gain of its own
    drives = [replace(d, stroke=120.0 * SLOPES[d.name]) for d in system.drives]
    system = replace(system, drives=tuple(drives))
    budget = dynamic_budget(STAGE, system, made, [loop]).budget("loop" if controlled else "open")
    shares = {s.name: budget.rms(s) ** 2 / budget.total**2 for s in budget.sources}
    assert all(share > 0.1 for name, share in shares.items() if controlled or name != "sensor")
    twin = small_stage(straight=True, environment=made, seed=2)
    # four standard deviations of a record of eight seconds
    limit = 4.0 * spread(budget, 8.0)
    assert limit < 0.09
    rms = at_rest(twin, settings if controlled else None, 8.0)
    assert rms == pytest.approx(budget.total, rel=limit)


FLOOR = """
  floor:
    kind: ground
    along: x
    spectrum: {kind: table, sided: one, points: [[1 Hz, 4.5 nm/rtHz], [100 Hz, 4.5 nm/rtHz],
      [5 kHz, 0.000255 nm/rtHz]]}
"""


@pytest.mark.slow
def test_fifty_nanometres_of_floor_move_the_twin_by_its_budget() -> None:
    floor = environment(FLOOR)
    f = np.geomspace(1.0, 5e3, 20_001)
    density = floor.sources[0].spectrum.density(f)
    assert math.sqrt(np.trapezoid(density, f)) == pytest.approx(50e-9, rel=0.02)
    stage = design("vgtu-piezo")
    twin = virtual_stage(stage, model="lumped", scatter=False, environment=floor)
    assert isinstance(twin, PiezoStage)
    notch = ServoSettings(integral=1.25e9, notches=(Notch(frequency_hz=915.3, zero_damping=0.0),))
    damping = ServoSettings(integral=1.94e9, lowpass_hz=1092.0)
    loops = {"open": None, "notch": notch, "damping": damping}
    named = [
        PositionLoop(name=name, settings=settings, delay=DELAY)
        for name, settings in loops.items() if settings is not None
    ]  # fmt: skip
    # the damping that the twin assumes
    system = lumped_system(stage).with_damping(ModalDamping(ratio=0.0087))
    predicted = dynamic_budget(stage, system, floor, named)
    moved = {name: at_rest(twin, settings, 20.0) for name, settings in loops.items()}
    for name, tolerance in (("open", 0.05), ("notch", 0.05), ("damping", 0.12)):
        budget = predicted.budget(name)
        assert 1.96 * spread(budget, 20.0) < 0.04
        assert moved[name] == pytest.approx(budget.total, rel=tolerance)
    # after a reversal a stack has a part of the gain of its stroke, by which the loop damps less
    stack = stack_of(twin.model.drive("x"))
    held = stack.simulate([60.0])
    slope = 1e3 * float(held.values[0] - stack.simulate([60.0 - 1e-3], held.state).values[0])
    gain = slope * twin.model.static_gain("x", "x") / 0.507e-6
    assert gain == pytest.approx(0.6, abs=0.02)
    weaker = replace(named[-1], settings=replace(damping, integral=gain * damping.integral))
    ours = dynamic_budget(stage, twin.model.system, floor, [weaker]).budget()
    assert moved["damping"] == pytest.approx(ours.total, rel=0.03)


def test_an_environment_that_cannot_move_a_twin_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "floor.yaml"
    path.write_text("environment: 1\nname: made\nband: [1 Hz, 5 kHz]\nsources:" + FLOOR)
    with pytest.raises(ModelError, match="has screws and is quasi-static, so no environment"):
        open_twin(f"twin://vgtu-mechanical?environment={path}", None, axes=None, timeout=None)
    white = "spectrum: {kind: white, level: 1 nm/rtHz, sided: one}"
    fast = environment(f"  a: {{kind: sensor, {white}}}", band="[50 kHz, 60 kHz]")
    with pytest.raises(ModelError, match="begins at 50000 Hz, and a loop at 10000 Hz has nothing"):
        small_stage(straight=True, environment=fast)
    hum = "spectrum: {kind: lines, at: [[50 Hz, 1 mV]]}"
    with pytest.raises(ModelError, match="no drive 'z'"):
        small_stage(
            straight=True, environment=environment(f"  a: {{kind: voltage, drive: z, {hum}}}")
        )
