"""The dynamic error budget against closed forms, Lyapunov's equation and simulated noise.

Evidence (Instruments, twin, control): dynamic error budget: one mode on a moving base (Miles), rms
of 60 modes by Lyapunov's equation, both 0.01 %; a sampled loop simulated with drawn noise, 2 %
"""

import math
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm, solve_continuous_lyapunov

from flexstage.base.errors import ModelError, StageError
from flexstage.control.dynamic_budget import DynamicBudget, dynamic_budget
from flexstage.lumped import lumped_system
from flexstage.quantities.table import Table
from flexstage.report.study_sections import quiet_section
from flexstage.stage.designs import design
from flexstage.system import MechanicalSystem, ModalDamping, modes
from flexstage.system.environment import (
    Environment,
    PositionLoop,
    environment_from_text,
    read_environment,
)
from flexstage.system.mechanical import (
    STANDARD_GRAVITY,
    AxisPort,
    BodyPort,
    DrivePort,
    LoadPort,
    ProbePort,
)
from flexstage.system.servo import ServoSettings
from flexstage.system.statics import static_displacements

PIEZO = design("vgtu-piezo")
MASS, OMEGA, ZETA = 0.37, 2.0 * math.pi * 290.0, 0.023
#: Spectra whose variance a closed form has need a band far beyond the mode.
WIDE = "[0.01 Hz, 300 kHz]"
FLOOR = "kind: ground, along: x"


def one_mass(*, spring: float = 0.0, zeta: float = ZETA, omega: float = OMEGA) -> MechanicalSystem:
    """A mass on a spring with the names of the piezo stage; `spring` is that of its drive."""
    return MechanicalSystem(
        name="mass",
        model="lumped",
        M=np.array([[MASS]]),
        K=np.array([[MASS * omega**2 - spring]]),
        coordinates=("x [m]",),
        drives=(DrivePort(name="x", vector=np.ones(1), stiffness=spring, stroke=38e-6),),
        probes=(ProbePort(name="x", vector=np.ones(1)),),
        bodies=(BodyPort(name="PY", centre=(0.0, 0.0), matrix=np.array([[1.0], [0.0], [0.0]])),),
        loads=(LoadPort(name="gravity x", vector=np.array([MASS * STANDARD_GRAVITY]), unit="g"),),
        axes=(AxisPort(name="x", drives=("x",), probe="x"),),
        damping=ModalDamping(ratio=zeta),
    )


def environment(*sources: str, band: str = WIDE, points: str = "") -> Environment:
    rows = "\n".join(f"  s{k}: {{{source}}}" for k, source in enumerate(sources))
    return environment_from_text(
        f"environment: 1\nname: made\nband: {band}\n{points}\nsources:\n{rows}\n"
    )


def white(level: str, sided: str = "one") -> str:
    return f"spectrum: {{kind: white, level: {level}, sided: {sided}}}"


def budget_of(
    system: MechanicalSystem, made: Environment, *loops: PositionLoop | str
) -> DynamicBudget:
    return dynamic_budget(PIEZO, system, made, loops)


def test_miles_and_white_force_on_one_mass() -> None:
    made = environment(
        f"{FLOOR}, {white('3 mm/s^2/rtHz')}",
        f"kind: force, body: PY, along: x, {white('2 mN/rtHz')}",
    )
    budget = budget_of(one_mass(), made).budget()
    floor, force = (budget.rms(source) for source in budget.sources)
    # Miles (1954): acceleration (pi/2 f0 Q S)^(1/2) of the spring's force over the mass
    miles = math.sqrt(0.5 * math.pi * OMEGA / (2.0 * math.pi) / (2.0 * ZETA)) * 3e-3
    assert OMEGA**2 * floor == pytest.approx(miles, rel=1e-4)
    assert force == pytest.approx(2e-3 / MASS / math.sqrt(8.0 * ZETA * OMEGA**3), rel=1e-4)
    assert budget.total == pytest.approx(math.hypot(floor, force))
    # half of a two-sided density is counted twice
    twice = budget_of(one_mass(), environment(f"{FLOOR}, {white('3 mm/s^2/rtHz', 'two')}"))
    assert twice.budget().total == pytest.approx(math.sqrt(2.0) * floor)
    # the same acceleration as a power
    power = budget_of(one_mass(), environment(f"{FLOOR}, {white('9e-6 (m/s^2)^2/Hz')}"))
    assert power.budget().total == pytest.approx(floor)


def test_what_to_improve_first_has_the_exponents_of_miles() -> None:
    made = environment(
        f"{FLOOR}, {white('3 mm/s^2/rtHz')}",
        f"kind: force, body: PY, along: x, {white('2 mN/rtHz')}",
    )
    budget = budget_of(one_mass(), made).budget()
    ranking = dict(budget.ranking())
    # sigma ~ zeta^(-1/2) K^(-3/4)
    assert ranking["damping"] == pytest.approx(-0.5, abs=1e-4)
    assert ranking["stiffness of the stage"] == pytest.approx(-0.75, abs=1e-4)
    shares = [budget.rms(source) ** 2 / budget.total**2 for source in budget.sources]
    assert [ranking["s0"], ranking["s1"]] == pytest.approx(shares)


@pytest.mark.parametrize("ratio", [0.1, 0.97, 1.0, 1.4, 30.0])
def test_a_line_of_the_ground_moves_one_mass_by_its_transmissibility(ratio: float) -> None:
    f0 = OMEGA / (2.0 * math.pi)
    hum = f"spectrum: {{kind: lines, at: [[{ratio * f0!r} Hz, 50 nm]]}}"
    points = "points: {base: {probe: x}, room: {probe: x, relative_to: room}}"
    result = budget_of(one_mass(), environment(f"{FLOOR}, {hum}", points=points))
    below = complex(1.0 - ratio**2, 2.0 * ZETA * ratio)
    # the dampers stand on the base, too
    room = 50e-9 * abs(complex(1.0, 2.0 * ZETA * ratio) / below)
    assert result.budget(point="room").total == pytest.approx(room, rel=1e-9)
    assert result.budget(point="base").total == pytest.approx(
        50e-9 * ratio**2 / abs(below), rel=1e-9
    )


def damping_matrix(system: MechanicalSystem) -> np.ndarray:
    every = modes(system, drives="in place", count=None)
    shapes = system.M @ every.shapes
    return shapes @ np.diag(2.0 * every.damping_ratio * every.omega) @ shapes.T


@pytest.mark.parametrize("along", ["x", "y", "rotation"])
def test_base_motion_is_that_of_absolute_coordinates(along: str) -> None:
    system = lumped_system(PIEZO)
    # absolute coordinates: springs and dampers of the base pull at the moving ground
    stiffness, damping = system.K + system.drive_springs("in place")[0], damping_matrix(system)
    ground = np.zeros(system.order)
    for body in system.bodies:
        x, y = body.centre
        motion = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "rotation": (-y, x, 1.0)}[along]
        ground += body.matrix.T @ np.array(motion)
    reader = system.probe("x").vector
    scale = "nrad" if along == "rotation" else "nm"
    # of another program, for a metre of the ground along x
    apart = {5.0: 3.058e-5, 300.0: 0.12349, 900.0: 33.019, 3000.0: 1.1166}
    for f, figure in apart.items():
        s = 2j * math.pi * f
        moved = np.linalg.solve(
            s**2 * system.M + s * damping + stiffness, (s * damping + stiffness) @ ground
        )
        hum = f"spectrum: {{kind: lines, at: [[{f} Hz, 1 {scale}]]}}"
        points = "points: {base: {probe: x}, room: {probe: x, relative_to: room}}"
        result = budget_of(
            system, environment(f"kind: ground, along: {along}, {hum}", points=points)
        )
        assert result.budget(point="room").total == pytest.approx(
            1e-9 * abs(reader @ moved), rel=1e-6
        )
        relative = result.budget(point="base").total
        assert relative == pytest.approx(1e-9 * abs(reader @ (moved - ground)), rel=1e-5)
        if along == "x":
            assert relative == pytest.approx(1e-9 * figure, rel=2e-4)


def test_a_drive_that_stands_on_the_base_accelerates_with_it() -> None:
    # a bar of 60 g from the mass to the base: a half of it moves with the mass
    ends = np.array([[[1.0], [0.0]], [[0.0], [0.0]]])
    port = DrivePort(name="x", vector=np.ones(1), stiffness=1e6, mass=0.06, ends=ends)
    system = replace(one_mass(), drives=(port,))
    assert system.base_force("x", "removed") == pytest.approx([MASS])
    assert system.base_force("x", "in place") == pytest.approx([MASS + 0.03])
    lumped = lumped_system(PIEZO)
    heavy = replace(lumped.drives[0], mass=0.06, ends=np.zeros((2, 2, lumped.order)))
    with pytest.raises(ModelError, match="does not include the mass of drive 'x'"):
        replace(lumped, drives=(heavy,)).base_force("rotation", "in place")


def test_rms_of_all_modes_is_that_of_lyapunov() -> None:
    system = lumped_system(PIEZO)
    every = modes(system, drives="in place", count=None)
    k = every.omega.size
    state = np.block(
        [
            [np.zeros((k, k)), np.diag(every.omega)],
            [-np.diag(every.omega), -np.diag(2.0 * every.damping_ratio * every.omega)],
        ]
    )
    made = environment(
        f"{FLOOR}, {white('3 mm/s^2/rtHz')}",
        f"kind: force, body: PY, along: y, {white('2 mN/rtHz')}",
    )
    budget = budget_of(system, made).budget()
    rigid = np.zeros(system.order)
    rigid[0::3] = 1.0
    force = system.body("PY").matrix[1]
    reader = system.probe("x").vector @ every.shapes
    for source, vector, level in zip(
        budget.sources, (system.M @ rigid, force), (3e-3, 2e-3), strict=True
    ):
        into = np.concatenate((np.zeros(k), every.shapes.T @ vector / every.omega))
        # a one-sided density S is an intensity of S/2
        covariance = solve_continuous_lyapunov(state, -0.5 * level**2 * np.outer(into, into))
        variance = reader @ covariance[:k, :k] @ reader
        assert budget.rms(source) == pytest.approx(math.sqrt(variance), rel=1e-4)


def test_rms_of_a_voltage_is_the_h2_norm_of_python_control() -> None:
    control = pytest.importorskip("control")
    system = one_mass(spring=2e5)
    made = environment(f"kind: voltage, drive: x, {white('0.1 mV/rtHz')}")
    gain = 2e5 * 38e-6 / 120.0 / MASS
    transfer = control.tf([gain], [1.0, 2.0 * ZETA * OMEGA, OMEGA**2])
    expected = control.norm(control.ss(transfer), 2) * 1e-4 / math.sqrt(2.0)
    assert budget_of(system, made).budget().total == pytest.approx(expected, rel=1e-4)


ENVIRONMENT = """
environment: 1
name: laboratory
band: [0.1 Hz, 5 kHz]
sources:
  floor: {kind: ground, along: x, spectrum: {kind: vc, curve: C, slope_above: -5}}
  sensor: {kind: sensor, spectrum: {kind: white, level: 0.02 nm/rtHz, sided: one, corner: 5 Hz}}
  step: {kind: sensor, spectrum: {kind: quantiser, step: 1 nm, rate: 10 kHz}}
  amplifier: {kind: voltage, drive: x, spectrum: {kind: lowpass, rms: 1 mV, bandwidth: 1 kHz}}
  DAC: {kind: voltage, drive: x, spectrum: {kind: quantiser, step: 2.28882 mV, rate: 10 kHz}}
  air: {kind: force, body: PY, along: x, spectrum: {kind: lowpass, rms: 1 mN, bandwidth: 30 Hz}}
"""


def test_budget_of_the_piezo_stage_computed_apart() -> None:
    # by 42 lines of Python of their own: modes in closed form, a continuous loop with a delay of
    # one and a half samples, a notch that blocks the first mode; they differ by the sampling
    apart = {
        "open": (3.64, 0.0, 0.0, 2.56, 1.28, 0.13, 4.63),
        "20 Hz": (3.69, 0.15, 0.02, 2.59, 1.29, 0.12, 4.69),
        "100 Hz": (3.84, 0.30, 0.06, 2.70, 1.34, 0.11, 4.89),
        "200 Hz": (4.05, 0.45, 0.09, 2.85, 1.42, 0.12, 5.17),
    }
    made = environment_from_text(ENVIRONMENT)
    result = budget_of(lumped_system(PIEZO), made, "20 Hz", "100 Hz", "200 Hz")
    for name, figures in apart.items():
        budget = result.budget(name)
        own = [1e9 * budget.rms(source) for source in budget.sources]
        # there the converter has no hold, which at the mode is a sinc
        own[4] /= np.sinc(910.0 / 10e3)
        assert [*own, 1e9 * budget.total] == pytest.approx(figures, rel=0.01, abs=0.01)


# the second mode lies where the hold is seen
@pytest.mark.parametrize(("mode", "zeta", "crossover"), [(310.0, 0.2, 60.0), (1200.0, 0.1, 120.0)])
def test_sampled_loop_with_drawn_noise(mode: float, zeta: float, crossover: float) -> None:
    """One mode under integral control, in steps of an eighth of a sample, against its budget."""
    omega, spring, rate, fine = 2.0 * math.pi * mode, 2e5, 4e3, 8
    volt = spring * 38e-6 / 120.0 / MASS  # acceleration
    integral = 2.0 * math.pi * crossover * omega**2 / volt
    force_rms, noise_rms, records, samples = 0.4, 3e-9, 500, 1000
    dt = 1.0 / (rate * fine)
    step = expm(
        np.array([[0.0, 1.0, 0.0], [-(omega**2), -2.0 * zeta * omega, 1.0], [0.0, 0.0, 0.0]]) * dt
    )
    rng = np.random.default_rng(20)
    squares = []
    for forced, read in ((force_rms, 0.0), (0.0, noise_rms)):
        x, computed, total, count = np.zeros((2, records)), np.zeros(records), 0.0, 0
        for k in range(samples):
            # a voltage acts one sample after its reading
            applied = computed
            computed = computed - integral / rate * (x[0] + read * rng.standard_normal(records))
            for pulse in forced * rng.standard_normal((fine, records)):
                x = step[:2, :2] @ x + np.outer(step[:2, 2], volt * applied + pulse / MASS)
                if k > samples // 10:
                    total += float(x[0] @ x[0])
                    count += records
        squares.append(total / count)
    made = environment(
        f"kind: force, body: PY, along: x, {white(f'{force_rms * math.sqrt(2.0 * dt)} N/rtHz')}",
        f"kind: sensor, {white(f'{noise_rms * math.sqrt(2.0 / rate)} m/rtHz')}",
        band="[0.1 Hz, 2 kHz]",
    )
    loop = PositionLoop(name="slow", settings=ServoSettings(integral=integral), sample_rate=rate)
    budget = budget_of(one_mass(spring=spring, zeta=zeta, omega=omega), made, loop).budget()
    # 500 records of 0.22 s at a noise bandwidth of 190 Hz: 1/sqrt(2 B T) is 0.5 %, two standard
    # deviations of the rms
    for source, square in zip(budget.sources, squares, strict=True):
        assert budget.rms(source) == pytest.approx(math.sqrt(square), rel=0.02)


def third_octave_rms(spectrum: str, middle: float, *, acceleration: bool = False) -> float:
    made = environment(f"{FLOOR}, spectrum: {spectrum}", band="[1 Hz, 80 Hz]")
    f = np.linspace(middle * 2.0 ** (-1.0 / 6.0), middle * 2.0 ** (1.0 / 6.0), 4001)
    weight = (2.0 * math.pi * f) ** 2 if acceleration else 1.0
    return math.sqrt(np.trapezoid(weight * made.sources[0].spectrum.density(f), f))


@pytest.mark.parametrize(
    ("curve", "velocity"),
    [("A", 50.0), ("B", 25.0), ("C", 12.5), ("D", 6.25), ("E", 3.12), ("F", 1.56), ("G", 0.78)],
)
def test_a_vibration_criterion_fills_every_third_of_an_octave(curve: str, velocity: float) -> None:
    spectrum = f"{{kind: vc, curve: {curve}}}"
    # Amick et al. 2005, um/s
    assert third_octave_rms(spectrum, 31.5) == pytest.approx(1e-6 * velocity, rel=1e-6)
    if curve in "AB":
        # 260 and 130 millionths of gravity from 4 to 8 Hz
        gravity = {"A": 260e-6, "B": 130e-6}[curve] * 9.80665
        assert third_octave_rms(spectrum, 5.0, acceleration=True) == pytest.approx(
            gravity, rel=1e-6
        )
        assert third_octave_rms(spectrum, 2.0) == 0.0
    else:
        assert third_octave_rms(spectrum, 5.0) == pytest.approx(1e-6 * velocity, rel=1e-6)


def test_figures_of_floor_and_slope_published() -> None:
    # VC-C at 10 Hz: 8.2 um/s and 131 nm per root hertz
    made = environment(
        f"{FLOOR}, spectrum: {{kind: vc, curve: C, slope_above: -5}}", band="[1 Hz, 1 kHz]"
    )
    density = made.sources[0].spectrum.density
    at = np.array([10.0, 80.0, 160.0, 0.5])
    values = density(at)
    assert 1e6 * math.sqrt(values[0]) == pytest.approx(8.2, abs=0.05)
    assert 1e9 * math.sqrt(values[0]) / (2.0 * math.pi * 10.0) == pytest.approx(131.0, abs=0.5)
    displacement = values / (2.0 * math.pi * at) ** 2
    assert displacement[2] == pytest.approx(displacement[1] / 32.0)
    assert values[3] == 0.0


def test_rounding_has_a_twelfth_of_the_square_of_its_step() -> None:
    rng = np.random.default_rng(3)
    signal = rng.normal(scale=3.0, size=100_000)
    made = environment(
        "kind: sensor, spectrum: {kind: quantiser, step: 2 nm, rate: 8 kHz}", band="[1 Hz, 10 kHz]"
    )
    f = np.linspace(1e-3, 10e3, 20_001)
    variance = np.trapezoid(made.sources[0].spectrum.density(f), f)
    assert variance == pytest.approx((2e-9) ** 2 / 12.0, rel=1e-3)
    assert variance == pytest.approx(float(np.var(np.round(signal) - signal)) * 4e-18, rel=0.02)
    # a converter that holds its values repeats the noise about multiples of its rate
    made = environment(
        "kind: voltage, drive: x, spectrum: {kind: quantiser, step: 2 mV, rate: 8 kHz}"
    )
    f = np.linspace(1e-3, 8e6, 2_000_001)
    held = made.sources[0].density(f)
    assert np.trapezoid(held, f) == pytest.approx((2e-3) ** 2 / 12.0, rel=1e-3)
    f = np.array([1e-3, 4e3, 8e3])
    sinc = [1.0, 2.0 / math.pi, 0.0]
    density = (2e-3) ** 2 / (6.0 * 8e3) * np.square(sinc)
    assert made.sources[0].density(f) == pytest.approx(density, abs=1e-18)


def test_noise_below_a_corner_and_behind_a_low_pass() -> None:
    made = environment(
        "kind: sensor, spectrum: {kind: white, level: 2 nm/rtHz, sided: one, corner: 5 Hz}",
        "kind: voltage, drive: x, spectrum: {kind: lowpass, rms: 1 mV, bandwidth: 1 kHz}",
        band="[0.1 Hz, 1 MHz]",
    )
    flicker, amplifier = (source.spectrum.density for source in made.sources)
    f = np.array([5.0, 0.5])
    assert flicker(f) == pytest.approx([8e-18, 44e-18])
    wide = np.geomspace(1e-3, 1e9, 200_001)
    assert np.trapezoid(amplifier(wide), wide) == pytest.approx(1e-6, rel=1e-5)


def test_tables_and_files_are_straight_lines_in_the_logarithms(tmp_path: Path) -> None:
    # 1/f^2 from 2 to 200 Hz
    np.savetxt(
        tmp_path / "floor.csv", [[0.0, 9.0], [2.0, 30.0], [200.0, 0.3]], delimiter=",",
        header="frequency,density", comments="",
    )  # fmt: skip
    text = f"""
environment: 1
name: made
band: [2 Hz, 200 Hz]
sources:
  table:
    {{{FLOOR}, spectrum: {{kind: table, sided: two, points: [[2 Hz, 30 um/s/rtHz],
    [200 Hz, 0.3 um/s/rtHz]]}}}}
  file: {{{FLOOR}, spectrum: {{kind: file, path: floor.csv, density_unit: um/s/rtHz, sided: one}}}}
"""
    (tmp_path / "floor.yaml").write_text(text)
    table, file = read_environment(tmp_path / "floor.yaml").sources
    f = np.array([2.0, 20.0, 200.0])
    assert file.spectrum.density(f) == pytest.approx([9e-10, 9e-12, 9e-14])
    assert table.spectrum.density(f) == pytest.approx([18e-10, 18e-12, 18e-14])
    zero = environment_from_text(
        text.replace("sided: one", "sided: one, outside: zero")
        .replace("path: floor.csv", f"path: '{tmp_path / 'floor.csv'}'")
        .replace("sided: two", "sided: two, outside: zero")
        .replace("200 Hz]\nsources", "900 Hz]\nsources")
    )
    assert zero.sources[1].spectrum.density(np.array([201.0]))[0] == 0.0


def test_an_exposure_averages_what_is_faster() -> None:
    # the moving average of a sine over a tenth of a second, by its samples
    f, duration = 13.0, 0.1
    made = environment(
        f"kind: voltage, drive: x, spectrum: {{kind: lines, at: [[{f} Hz, 1 mV]]}}",
        band="[1 Hz, 1 kHz]",
    )
    budget = budget_of(one_mass(spring=2e5), made).budget()
    t = np.arange(0.0, 1.0, 1e-4)
    sine = math.sqrt(2.0) * budget.total * np.sin(2.0 * math.pi * f * t)
    window = np.ones(1000) / 1000.0
    averaged = np.convolve(np.tile(sine, 3), window, mode="same")[10_000:20_000]
    average, deviation = budget.exposed(duration)
    assert average == pytest.approx(math.sqrt(np.mean(averaged**2)), rel=1e-3)
    assert math.hypot(average, deviation) == pytest.approx(budget.total)
    # all of it lies between 10 and 100 Hz
    assert budget.rms(budget.sources[0], (10.0, 100.0)) == pytest.approx(budget.total)
    assert budget.rms(budget.sources[0], (100.0, 1000.0)) == 0.0
    assert budget.bands == ((1.0, 10.0), (10.0, 100.0), (100.0, 1000.0))


def test_largest_value_and_scatter_of_drawn_records() -> None:
    f0, zeta, duration, records, rate = 100.0, 0.3, 10.0, 100, 4e3
    system = one_mass(omega=2.0 * math.pi * f0, zeta=zeta)
    made = environment(f"kind: force, body: PY, along: x, {white('2 mN/rtHz')}")
    budget = budget_of(system, made).budget()
    # under white noise the mean square of the speed is that of the motion by the square of omega
    assert budget.moment(2) == pytest.approx((2.0 * math.pi * f0 * budget.total) ** 2, rel=0.01)
    # a of 2000 peaks of both signs
    a = math.sqrt(2.0 * math.log(2.0 * f0 * duration))
    assert budget.peak(duration) / budget.total == pytest.approx(a + 0.57722 / a, rel=1e-3)
    size = round(records * duration * rate)
    f = np.fft.rfftfreq(size, 1.0 / rate)
    omega, own = 2.0 * np.pi * f, 2.0 * np.pi * f0
    response = 2e-3 / MASS / np.abs(own**2 - omega**2 + 2j * zeta * own * omega)
    draw = np.random.default_rng(4).standard_normal((2, f.size))
    spectrum = np.sqrt(0.25 * rate * size) * response * (draw[0] + 1j * draw[1])
    motion = np.fft.irfft(spectrum, n=size).reshape(records, -1)
    assert np.abs(motion).max(axis=1).mean() == pytest.approx(budget.peak(duration), rel=0.03)
    rms = motion.std(axis=1)
    assert rms.std() / budget.total == pytest.approx(budget.spread(duration), rel=0.3)
    with pytest.raises(ModelError, match=r"upward 100 times a second, and .* shorter than one"):
        budget.peak(1e-3)


@pytest.mark.parametrize(("noise", "wanted", "reached"), [(0.3, 12.0, True), (3.0, 12.0, False)])
def test_smallest_bandwidth_for_an_rms(noise: float, wanted: float, reached: bool) -> None:
    # far below its mode the stage follows the loop: S = s/(s + wc), T = wc/(s + wc)
    hum, still = 5.0, 100.0
    system = one_mass(spring=2e5, omega=2.0 * math.pi * 12e3, zeta=0.2)
    volt = 2e5 * 38e-6 / 120.0 / (MASS * (2.0 * math.pi * 12e3) ** 2)
    made = environment(
        "kind: voltage, drive: x, "
        f"spectrum: {{kind: lines, at: [[{hum} Hz, {1e-9 * still / volt!r} V]]}}",
        f"kind: sensor, {white(f'{noise} nm/rtHz')}",
        band="[0.01 Hz, 2 kHz]",
    )
    result = dynamic_budget(PIEZO, system, made, ["20 Hz"], wanted_rms=1e-9 * wanted)
    found = result.required
    assert found is not None
    assert result.budget("open").total == pytest.approx(1e-9 * still, rel=1e-5)
    fc = np.geomspace(1.0, 400.0, 100_001)
    rms = np.sqrt(still**2 * hum**2 / (hum**2 + fc**2) + 0.5 * np.pi * fc * noise**2)
    assert 1e9 * found.least == pytest.approx(rms.min(), rel=0.05)
    assert found.least_bandwidth_hz == pytest.approx(fc[np.argmin(rms)], rel=0.1)
    if reached:
        assert found.bandwidth_hz == pytest.approx(fc[np.argmax(rms <= wanted)], rel=0.05)
    else:
        assert rms.min() > wanted
        assert found.bandwidth_hz is None
        assert found.sentence.startswith("the noise of the sensor forbids less: 6")
    assert result.to_dict()["required"]["least"] == found.least
    with pytest.raises(ModelError, match="a required rms needs a loop"):
        dynamic_budget(PIEZO, system, made, wanted_rms=1e-9)


def test_what_forbids_a_smaller_rms_is_named() -> None:
    made = environment_from_text(ENVIRONMENT)
    notched = dynamic_budget(
        PIEZO, lumped_system(PIEZO), made, ["100 Hz"], wanted_rms=3e-9
    ).required
    assert notched is not None
    # an integral loop and a notch do nothing about the mode
    assert (notched.bandwidth_hz, notched.least_bandwidth_hz) == (None, 0.0)
    assert notched.sentence.startswith("the mode at 910.3 Hz forbids less: 9")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("0.02 nm/rtHz", "0.02", "expected a density with its unit"),
        ("0.02 nm/rtHz", "0.02 nm", "such as '0.02 nm/rtHz' or '4e-22 m"),
        ("0.02 nm/rtHz", "1e-9", "got '1e-9'"),
        # of a speed, or of an acceleration
        ("0.02 nm/rtHz", "2 m/s^2/Hz", r"write \(m/s\)\^2/Hz or \(m/s\^2\)\^2/Hz"),
        ("rms: 1 mN", "rms: 1", "expected a size with its unit"),
        ("rms: 1 mN", "rms: -1 mN", "above 0"),
        ("1 mN", "1 mV", "source 'air' acts as force, in N, got a spectrum in V"),
        (", sided: one", "", "'sided' is missing"),
        (", slope_above: -5", "", "no vibration criterion says anything above 80 Hz"),
        ("kind: vc, curve: C, slope_above: -5", "kind: lines, at: [[9 kHz, 1 nm]]",
         "source 'floor': the line at 9000 Hz lies outside the band of 0.1 to 5000 Hz"),
        ("kind: vc, curve: C, slope_above: -5",
         "kind: table, sided: one, points: [[1 Hz, 1 m/s/rtHz], [9 Hz, 1 m/s/rtHz]]",
         "its densities from 1 to 9 Hz do not cover the band of 0.1 to 5000 Hz: narrow the band"),
        ("kind: vc, curve: C, slope_above: -5",
         "kind: table, sided: one, points: [[9 Hz, 1 m/s/rtHz], [1 Hz, 1 m/s/rtHz]]", "rising"),
        ("[0.1 Hz, 5 kHz]", "[5 kHz, 0.1 Hz]", "band must rise"),
        ("ground, along: x", "ground, along: up", "one of x, y, rotation"),
    ],
)  # fmt: skip
def test_a_faulty_environment_is_refused_in_a_sentence(old: str, new: str, message: str) -> None:
    assert old in ENVIRONMENT
    with pytest.raises(ModelError, match=message):
        environment_from_text(ENVIRONMENT.replace(old, new))


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("body: PY", "body: lid", "no body 'lid'"),
        ("body: PY", "body: G", "source 'air': body 'G' is fixed"),
        ("drive: x", "drive: z", "'z'"),
        ("0.02 nm/rtHz", "0.02 nrad/rtHz", "source 'sensor' is noise in rad, but .* reads m"),
        ("sources:", "points: {tip: {probe: tip}}\nsources:", "no probe 'tip'"),
    ],
)
def test_what_the_stage_does_not_have_is_refused(old: str, new: str, message: str) -> None:
    made = environment_from_text(ENVIRONMENT.replace(old, new))
    with pytest.raises((ModelError, StageError), match=message):
        budget_of(lumped_system(PIEZO), made)


def test_probes_of_two_units_have_no_difference() -> None:
    stage = design("three-rrr")
    made = environment(
        f"{FLOOR}, spectrum: {{kind: vc, curve: C}}",
        band="[1 Hz, 80 Hz]",
        points="points: {tip: {probe: x, relative_to: theta}}",
    )
    with pytest.raises(ModelError, match="point 'tip': probe 'x' reads m, and 'theta' reads rad"):
        dynamic_budget(stage, lumped_system(stage), made)


def test_a_mode_without_damping_has_no_rms() -> None:
    made = environment(f"{FLOOR}, {white('3 mm/s^2/rtHz')}", band="[1 Hz, 1 kHz]")
    with pytest.raises(ModelError, match="the mode at 290 Hz has no damping"):
        budget_of(one_mass(zeta=0.0), made)


def test_loops_of_a_stage_whose_modes_lie_above_half_their_rate() -> None:
    made = environment(f"{FLOOR}, {white('3 mm/s^2/rtHz')}", band="[1 Hz, 1 kHz]")
    fast = one_mass(spring=2e5, omega=2.0 * math.pi * 12e3, zeta=0.2)
    opened, slow, tuned = budget_of(fast, made, "20 Hz", "tune").budgets
    assert slow.margins is not None
    assert slow.margins.crossover_hz == pytest.approx(20.0, rel=0.01)
    assert tuned.total < slow.total < opened.total
    ringing = one_mass(spring=2e5, omega=2.0 * math.pi * 12e3, zeta=0.01)
    with pytest.raises(ModelError, match=r"raise its rate beyond twice the mode at 1\.2e"):
        budget_of(ringing, made, "tune")


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(
    "source",
    [
        "kind: voltage, drive: x, spectrum: {kind: lines, at: [[50 Hz, 1 mV]]}",
        f"kind: sensor, {white('1 nm/rtHz')}",
    ],
    ids=("lines alone", "no motion"),
)
def test_a_budget_without_density_is_drawn(source: str) -> None:
    made = environment(source, band="[1 Hz, 1 kHz]")
    figure = budget_of(one_mass(spring=2e5), made).plot()
    density, amplitude = figure.axes[:2]
    assert density.get_xlim() == amplitude.get_xlim()


def test_a_source_may_have_the_name_of_a_lever() -> None:
    text = ENVIRONMENT.replace("  floor:", "  damping:")
    budget = budget_of(lumped_system(PIEZO), environment_from_text(text)).budget()
    share = budget.rms(budget.sources[0]) ** 2 / budget.total**2
    values = sorted(value for name, value in budget.ranking() if name == "damping")
    assert values == pytest.approx([budget.levers["damping"], share])


@pytest.mark.parametrize("row", ["10, -110", "10, nan", "-10, 110"])
def test_a_file_of_decibels_or_gaps_is_refused(tmp_path: Path, row: str) -> None:
    (tmp_path / "floor.csv").write_text(f"frequency,density\n0, 1\n1, 30\n{row}\n100, 3\n")
    spectrum = "{kind: file, path: floor.csv, density_unit: nm/rtHz, sided: one}"
    path = tmp_path / "floor.yaml"
    path.write_text(
        f"environment: 1\nname: made\nband: [1 Hz, 80 Hz]\n"
        f"sources:\n  floor: {{{FLOOR}, spectrum: {spectrum}}}\n"
    )
    with pytest.raises(ModelError, match=r"'floor.csv' has .* not above 0"):
        read_environment(path)


def test_an_unstable_loop_and_a_drive_without_voltage_are_refused() -> None:
    made = environment_from_text(ENVIRONMENT)
    gain = 5.068e-7
    fast = PositionLoop(name="fast", settings=ServoSettings(integral=2.0 * math.pi * 100.0 / gain))
    with pytest.raises(ModelError, match="loop 'fast' is unstable on this stage: reduce its gain"):
        budget_of(lumped_system(PIEZO), made, fast)
    with pytest.raises(ModelError, match=r"there is no file none\.yaml"):
        budget_of(lumped_system(PIEZO), made, "none.yaml")
    for text in ("0.5", "0 Hz", "100"):
        with pytest.raises(ModelError, match=f"such as '100 Hz', tune, or the file.*'{text}'"):
            budget_of(lumped_system(PIEZO), made, text)
    with pytest.raises(ModelError, match="two loops are named '100 Hz'"):
        budget_of(lumped_system(PIEZO), made, "100 Hz", "100 Hz")
    with pytest.raises(ModelError, match="loop 'none' has no gain"):
        PositionLoop(name="none", settings=ServoSettings())
    with pytest.raises(ModelError, match="has no axis to control: add one"):
        dynamic_budget(replace(PIEZO, axes=()), lumped_system(PIEZO), made)
    screws = design("vgtu-mechanical")
    floor = environment(f"{FLOOR}, spectrum: {{kind: vc, curve: C}}", band="[1 Hz, 80 Hz]")
    assert dynamic_budget(screws, lumped_system(screws), floor).budget().total > 0.0
    with pytest.raises(ModelError, match="drive 'x' is a screw without a voltage range"):
        dynamic_budget(screws, lumped_system(screws), floor, ["50 Hz"])


def test_a_file_of_a_loop_and_the_damping_loop(tmp_path: Path) -> None:
    path = tmp_path / "slow.yaml"
    path.write_text(
        "loop: 1\nsample_rate: 20 kHz\ndelay: 0.1 ms\n"
        "settings: {integral: 2.4e8, notches: [{frequency_hz: 910.33, zero_damping: 0.0}]}\n"
    )
    made = environment_from_text(ENVIRONMENT)
    result = budget_of(lumped_system(PIEZO), made, str(path), "tune")
    opened, slow, tuned = result.budgets
    assert [opened.loop, slow.loop, tuned.loop] == ["open", "slow", "tune"]
    assert slow.margins is not None
    # 2.4e8 V/(m s) of 0.507 um/V is a crossover of 19.4 Hz
    assert slow.margins.crossover_hz == pytest.approx(19.4, abs=0.1)
    # half of the variance is at the mode, which the damping loop damps
    assert tuned.total < 0.6 * opened.total
    assert slow.total > opened.total


STATIC = """
static:
  temperature: 0.5 K
  travel: 40 um
  creep: 0.02
  hysteresis: 0.005
  sensor: {nonlinearity: 2e-4, alignment: 20 mrad, abbe_offset: 8 mm, expansion: 1.2 ppm/K,
    length_of_loop: 30 mm, calibration: 1e-4}
"""


def test_static_errors_and_rms_are_one_tree_of_errors() -> None:
    made = environment_from_text(ENVIRONMENT + STATIC)
    # 0.7 um/K on a base without expansion, of a model that has none of its own
    mean = lumped_system(PIEZO)
    # an oblique spring, by which the platform turns as it moves
    moved = mean.body(mean.probe("x").body).matrix
    oblique = moved[0] + 20e-3 * moved[2]
    mean = replace(mean, K=mean.K + 1e6 * np.outer(oblique, oblique))
    pull = mean.K @ np.linalg.solve(mean.K, mean.probe("x").vector)
    rate = 0.7e-6 / float(mean.probe("x").vector @ np.linalg.solve(mean.K, pull))
    heated = LoadPort(name="temperature", vector=rate * pull, unit="K")
    result = budget_of(replace(mean, loads=(*mean.loads, heated)), made, "100 Hz")
    static = static_displacements(mean, {"x": mean.drive("x").stroke or 0.0})
    turn = static.body_motion[mean.probe("x").body][2] * 40e-6 / static.readings["x"]
    root = math.sqrt(3.0)
    # half-widths over the root of three (JCGM 100, 4.3.7)
    abbe = 0.5 * 8e-3 * abs(turn) / root
    assert abbe > 1e-9
    expected = {
        "open": {"thermal drift": 0.5 * 0.7e-6 / root, "creep": 0.02 * 40e-6 / root,
                 "hysteresis": 0.005 * 40e-6 / root, "Abbe": abbe},
        "100 Hz": {"nonlinearity": 2e-4 * 40e-6 / root, "calibration": 1e-4 * 40e-6,
                   "sensor mount": 1.2e-6 * 30e-3 * 0.5 / root, "Abbe": abbe,
                   # 1 - cos a of a normal angle
                   "cosine": 40e-6 * float(np.std(1.0 - np.cos(
                       np.random.default_rng(1).normal(scale=0.02, size=1_000_000))))},
    }  # fmt: skip
    for loop, parts in expected.items():
        budget = result.budget(loop)
        tree = budget.tree
        assert tree is not None
        found = {line.name: line.uncertainty for line in tree.lines}
        assert found == pytest.approx(parts | {"vibration and noise": budget.total}, rel=0.01)
        assert tree.uncertainty == pytest.approx(math.hypot(*found.values()), rel=1e-9)
        assert sum(line.share for line in tree.lines) == pytest.approx(1.0)
        assert all(line.source for line in tree.lines)
    plain = result.to_dict()["totals"][1]["tree"]
    assert plain["uncertainty"] == pytest.approx(result.budget().tree.uncertainty)
    bars = result.plot().axes[2]
    assert sorted(t.get_text() for t in bars.get_yticklabels()) == sorted(found)
    study: Any = SimpleNamespace(budget=result, request=None)
    tables = [c for c in quiet_section(study) if isinstance(c, Table)]
    # one of the rms, and a tree of each budget
    assert [t.caption for t in tables[1:]] == ["Errors of x, standard uncertainty [um]."] * 2
    combined = next(r for r in tables[2].rows if r[0].text == "combined")
    assert float(combined[2].text) == pytest.approx(1e6 * tree.uncertainty, rel=1e-2)
    with pytest.raises(ModelError, match="has no thermal expansion: choose --model superelement"):
        budget_of(mean, made)
    assert budget_of(mean, environment_from_text(ENVIRONMENT)).budget().tree is None
    # the stage as it is turns by roundings alone
    without = environment_from_text(ENVIRONMENT + STATIC.replace("  temperature: 0.5 K\n", ""))
    tree = budget_of(lumped_system(PIEZO), without).budget("open").tree
    assert tree is not None
    assert {line.name: line.uncertainty for line in tree.lines}["Abbe"] == 0.0


def test_control_of_an_axis_leaves_the_static_errors_of_another() -> None:
    points = "points: {across: {probe: y}, turn: {probe: turn}}\n"
    made = environment_from_text(ENVIRONMENT + STATIC + points)
    system = lumped_system(PIEZO)
    port = system.probe("x")
    # a probe of an angle that turns by 3 rad for a metre
    turn = ProbePort(name="turn", vector=3.0 * port.vector, unit="rad", body=port.body)
    heated = LoadPort(name="temperature", vector=0.0 * port.vector, unit="K")
    system = replace(system, probes=(*system.probes, turn), loads=(*system.loads, heated))
    root = math.sqrt(3.0)
    result = budget_of(system, made, "100 Hz")
    across = result.budget("100 Hz", "across").tree
    assert across is not None
    found = {line.name: line.uncertainty for line in across.lines}
    assert found["creep"] == pytest.approx(0.02 * 40e-6 / root)
    assert "nonlinearity" not in found
    tree = result.budget("100 Hz", "turn").tree
    assert tree is not None
    # shares of the rotation over the travel; a mount that grows by a length turns nothing
    found = {line.name: line.uncertainty for line in tree.lines}
    assert found["nonlinearity"] == pytest.approx(2e-4 * 3.0 * 40e-6 / root)
    assert "sensor mount" not in found
