r"""The entire dynamic model: against integration of its equations, and its static limits.

Evidence (Hysteresis and records): whole model with two creeping stacks (integration):
$2\cdot10^{-10}$ µm

Evidence (Exported files): `DynamicModel`, stacks with creep (integration of every equation):
$2\cdot10^{-10}$ µm
"""

import dataclasses

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from flexstage.base.arrays import Array
from flexstage.base.errors import ModelError
from flexstage.hysteresis import BoucWen
from flexstage.hysteresis.build_model import assembled_model, dynamic_model
from flexstage.hysteresis.chain.amplifier import Amplifier
from flexstage.hysteresis.chain.creep import LogCreep
from flexstage.hysteresis.chain.sensor import Sensor
from flexstage.hysteresis.dynamic_model import DynamicModel, ModelDrive
from flexstage.lumped import lumped_system
from flexstage.stage import PiezoStack
from flexstage.stage.designs import design
from flexstage.system import (
    MechanicalSystem,
    ModalDamping,
    modes,
    static_displacements,
    time_response,
)
from flexstage.system.mechanical import DrivePort, ProbePort

#: um of free displacement, so that 5e-12 is rounding of the stroke
STACK = BoucWen(gain=0.38, hysteresis_gain=0.11, beta=0.05, gamma=0.03)
OTHER = BoucWen(gain=0.33, hysteresis_gain=0.07, beta=0.04, gamma=0.03)


def two_masses(ratio: float) -> MechanicalSystem:
    return MechanicalSystem(
        name="two masses",
        model="lumped",
        M=np.array([[0.31, 0.02], [0.02, 0.83]]),
        K=np.array([[9.1e6, -6.3e6], [-6.3e6, 7.7e6]]),
        coordinates=("a [m]", "b [m]"),
        drives=(
            DrivePort(name="x", vector=np.array([1.0, 0.1]), stiffness=4.1e7),
            DrivePort(name="y", vector=np.array([-0.2, 0.9]), stiffness=2.7e7),
        ),
        probes=(
            ProbePort(name="p", vector=np.array([0.3, 1.1])),
            ProbePort(name="q", vector=np.array([1.0, -0.4])),
        ),
        damping=ModalDamping(ratio=ratio),
    )


def voltages(count: int, seed: int) -> Array:
    u = np.random.default_rng(seed).uniform(0.0, 120.0, count)
    u[0] = 0.0
    return u


def integrated(
    system: MechanicalSystem,
    creep: LogCreep,
    u: dict[str, Array],
    dt: float,
) -> Array:
    """Readings by DOP853 of every equation at once, split where a hysteresis passes zero."""
    models = {"x": STACK, "y": OTHER}
    added, _ = system.drive_springs("in place")
    K = system.K + added
    held = modes(system, drives="in place", count=None)
    C = system.M @ held.shapes * (2.0 * held.damping_ratio * held.omega) @ held.shapes.T @ system.M
    inverse = np.linalg.inv(system.M)
    tau, lag_gain = creep.time_constants, creep.lag_gain
    m = tau.size
    laws, ports = list(models.values()), [system.drive(name) for name in models]
    gain = np.array([p.gain for p in laws])
    hysteresis_gain = np.array([p.hysteresis_gain for p in laws])
    beta, gamma = np.array([p.beta for p in laws]), np.array([p.gamma for p in laws])
    push = np.array([(p.stiffness or 0.0) * p.vector for p in ports])
    state = np.zeros(4 + 2 * (1 + m))
    probes = np.array([p.vector for p in system.probes])
    out = [np.zeros(2)]

    def rates(_: float, s: Array, a: Array, slope: Array, t0: float) -> Array:
        t = _ - t0
        q, v, own = s[:2], s[2:4], s[4:].reshape(2, 1 + m)
        h, lag = own[:, 0], own[:, 1:]
        w = gain * (a + slope * t) - h
        force = (w + lag_gain * lag.sum(axis=1)) @ push
        ds = np.empty_like(s)
        ds[:2], ds[2:4] = v, inverse @ (force - C @ v - K @ q)
        of_drives = ds[4:].reshape(2, 1 + m)
        of_drives[:, 0] = hysteresis_gain * slope - beta * abs(slope) * h - gamma * slope * abs(h)
        of_drives[:, 1:] = (w[:, None] - lag) / tau
        return ds

    def first(_: float, s: Array, *__: object) -> float:
        return float(s[4])

    def second(_: float, s: Array, *__: object) -> float:
        return float(s[4 + 1 + m])

    first.terminal = second.terminal = True  # type: ignore[attr-defined]
    for k in range(u["x"].size - 1):
        a = np.array([u["x"][k], u["y"][k]])
        slope = (np.array([u["x"][k + 1], u["y"][k + 1]]) - a) / dt
        t = 0.0
        while t < dt:
            found = solve_ivp(
                rates,
                (t, dt),
                state,
                method="DOP853",
                rtol=1e-13,
                atol=1e-12,
                args=(a, slope, 0.0),
                events=(first, second),
            )
            state, t = found.y[:, -1].copy(), float(found.t[-1])
            for i, place in enumerate((4, 4 + 1 + m)):
                if found.status == 1 and found.t_events[i].size:
                    state[place] = np.copysign(1e-15, slope[i])
        out.append(probes @ state[:2])
    return np.array(out).T


def test_model_against_integration_of_every_equation() -> None:
    system = two_masses(0.013)
    creep = LogCreep(rate_per_decade=0.06, shortest=2e-4, longest=0.05, per_decade=1)
    dt = 4.3e-4
    model = assembled_model(
        system,
        [
            ModelDrive(name="x", hysteresis=STACK, creep=creep),
            ModelDrive(name="y", hysteresis=OTHER, creep=creep),
        ],
        step=dt,
    )
    u = {"x": voltages(15, 1), "y": voltages(15, 2)}
    found = model.simulate(u)
    exact = integrated(system, creep, u, dt)
    mine = np.array([found.readings["p"], found.readings["q"]])
    assert np.abs(exact).max() > 20.0
    assert np.abs(mine - exact).max() < 2e-10


def test_without_hysteresis_the_model_is_the_linear_system() -> None:
    system = two_masses(0.013)
    linear = BoucWen(gain=0.41, hysteresis_gain=1e-300, beta=0.05, gamma=0.03)
    drives = [ModelDrive(name=name, hysteresis=linear) for name in ("x", "y")]
    model = assembled_model(system, drives, step=3.1e-4)
    u = {"x": voltages(300, 3), "y": voltages(300, 4)}
    t = model.step * np.arange(300)
    exact = time_response(system, t, {name: 0.41 * v for name, v in u.items()}).readings
    found = model.simulate(u)
    assert found.time == pytest.approx(t, abs=1e-15)
    for name in ("p", "q"):
        assert np.abs(found.readings[name] - exact[name]).max() < 1e-11


def test_a_displacement_that_stays_gives_the_static_one_times_the_load_factor() -> None:
    stage = design("vgtu-piezo")
    system = lumped_system(stage)
    creep = LogCreep(rate_per_decade=0.02, shortest=0.01, longest=1.0)
    stack = BoucWen(gain=3.1e-7, hysteresis_gain=0.9e-7, beta=0.05, gamma=0.03)
    model = assembled_model(
        system,
        [
            ModelDrive(name="x", hysteresis=stack, creep=creep),
            ModelDrive(name="y", hysteresis=stack),
        ],
    )
    found = model.simulate({"x": np.full(3, 87.0), "y": np.full(3, 0.0)})
    free = found.free_displacement["x"][-1]
    assert free == pytest.approx(stack.simulate([87.0]).values[0] * creep.static_gain, rel=1e-12)
    imposed = static_displacements(system, {"x": free}, others="in place")
    k_in = imposed.drive_force["x"] / free
    assert model.load_factor("x") == pytest.approx(5e7 / (5e7 + k_in), rel=1e-10)
    for probe in ("x", "y"):
        exact = imposed.readings[probe] * model.load_factor("x")
        assert found.readings[probe][-1] == pytest.approx(exact, rel=1e-8, abs=1e-15)
        assert model.static_gain("x", probe) * free == pytest.approx(exact, rel=1e-8, abs=1e-15)
    assert model.static_gain("y", "y") > 1.0


def test_load_factor_counts_the_other_stacks() -> None:
    model = whole_model()
    system = model.system
    x, y = (drive.vector for drive in system.drives)
    # compliance at the first drive, with the spring of the second in place
    compliance = x @ np.linalg.solve(system.K + 2.7e7 * np.outer(y, y), x)
    assert model.load_factor("x") == pytest.approx(1.0 / (1.0 + 1.0 / (4.1e7 * compliance)))
    alone = x @ np.linalg.solve(system.K, x)
    assert abs(model.load_factor("x") * (1.0 + 1.0 / (4.1e7 * alone)) - 1.0) > 0.01


def whole_model(step: float = 2.3e-4) -> DynamicModel:
    creep = LogCreep(rate_per_decade=0.03, shortest=1e-3, longest=1.0)
    amplifier = Amplifier(
        bandwidth_hz=400.0, capacitance=6.4e-6, current_limit=0.3, voltage_range=(0.0, 120.0)
    )
    other = BoucWen(gain=0.33, hysteresis_gain=0.07, beta=0.04, gamma=0.03, exponent=1.7)
    return assembled_model(
        two_masses(0.013),
        [
            ModelDrive(name="x", hysteresis=STACK, creep=creep, amplifier=amplifier),
            ModelDrive(name="y", hysteresis=other, creep=creep),
        ],
        step=step,
        sensors={"q": Sensor(noise_rms=0.01, seed=4, bandwidth_hz=900.0)},
    )


def test_a_record_may_be_cut_anywhere() -> None:
    model = whole_model()
    u = {"x": voltages(60, 5), "y": 30.0 + voltages(60, 6)}
    whole = model.simulate(u)
    state, parts = None, []
    for a, b in ((0, 1), (1, 23), (23, 60)):
        part = model.simulate({name: v[a:b] for name, v in u.items()}, state)
        state = part.state
        parts.append(part)
    assert np.concatenate([p.time for p in parts]) == pytest.approx(whole.time, abs=1e-12)
    for name in ("p", "q"):
        both = np.concatenate([p.motion[name] for p in parts])
        assert np.abs(both - whole.motion[name]).max() < 5e-12
    both = np.concatenate([p.readings["q"] for p in parts])
    assert np.abs(both - whole.readings["q"]).max() < 5e-12
    assert np.std(whole.readings["q"][1:] - whole.motion["q"][1:]) > 0.005
    quiet = model.as_exported().simulate(u)
    assert np.std(quiet.readings["q"][1:] - whole.readings["q"][1:]) == pytest.approx(0.01, rel=0.3)
    assert np.array_equal(quiet.motion["q"], whole.motion["q"])
    for name in ("x", "y"):
        both = np.concatenate([p.free_displacement[name] for p in parts])
        assert np.abs(both - whole.free_displacement[name]).max() < 5e-12
    assert whole.voltage["x"].max() <= 120.0
    assert np.abs(np.diff(whole.voltage["x"])).max() <= 0.3 / 6.4e-6 * model.step * (1.0 + 1e-12)
    assert whole.voltage["y"] == pytest.approx(u["y"])


def test_drives_that_are_not_named_keep_their_voltage() -> None:
    model = whole_model()
    start = model.settled({"y": 71.0})
    u = voltages(30, 7)
    alone = model.simulate({"x": u}, start)
    both = model.simulate({"x": u, "y": np.full(30, 71.0)}, start)
    assert alone.motion["p"] == pytest.approx(both.motion["p"], abs=1e-13)
    assert alone.free_displacement["y"] == pytest.approx(
        alone.free_displacement["y"][0] * np.ones(30), rel=1e-12
    )
    assert alone.time[0] == pytest.approx(0.0, abs=1e-18)


def test_settled_is_where_a_long_wait_ends() -> None:
    model = whole_model(step=2e-2)
    wait = model.simulate({"x": np.full(400, 83.0), "y": np.full(400, 27.0)})
    assert np.ptp(wait.readings["p"]) < 1e-11
    jump = model.simulate({"x": np.full(400, 83.0)}, model.settled({"x": 80.0, "y": 27.0}))
    # on the way up from 80 to 83 nothing is forgotten that 83 would not have
    assert jump.readings["p"][-1] == pytest.approx(wait.readings["p"][-1], rel=1e-3)
    assert jump.readings["p"][-1] == pytest.approx(wait.readings["p"][-1], abs=1e-3)
    assert abs(jump.readings["p"][0] - wait.readings["p"][0]) > 0.04


def test_the_stage_gives_range_and_capacitance() -> None:
    stage = design("vgtu-piezo")
    system = lumped_system(stage)
    stack = BoucWen(gain=3.8e-7, hysteresis_gain=1.1e-7, beta=0.05, gamma=0.03)
    both = {"x": stack, "y": stack}
    model = dynamic_model(stage, system, hysteresis=both, bandwidth=700.0, current=0.2)
    amplifier = model.drive("x").amplifier
    assert amplifier is not None
    assert amplifier.voltage_range == (0.0, 120.0)
    assert amplifier.largest_rate == pytest.approx(0.2 / 6.4e-6)
    with pytest.raises(ModelError, match="must be the free displacement in m"):
        dynamic_model(stage, system, hysteresis={"x": STACK})
    with pytest.raises(ModelError, match="no piezo stack, nor an axis of one"):
        dynamic_model(stage, system, hysteresis={"z": stack})
    with pytest.raises(ModelError, match="give its bandwidth too"):
        dynamic_model(stage, system, hysteresis=both, current=0.2)
    assert isinstance(stage.drives[0], PiezoStack)
    blank = dataclasses.replace(
        stage, drives=(dataclasses.replace(stage.drives[0], capacitance=None), stage.drives[1])
    )
    with pytest.raises(ModelError, match="has no capacitance"):
        dynamic_model(blank, system, hysteresis=both, bandwidth=700.0, current=0.2)
    screws = design("vgtu-mechanical")
    with pytest.raises(ModelError, match="is no piezo stack"):
        dynamic_model(screws, lumped_system(screws), hysteresis={screws.drives[0].name: stack})


def test_the_model_has_every_mode() -> None:
    system = lumped_system(design("vgtu-piezo"))
    stack = BoucWen(gain=3.8e-7, hysteresis_gain=1e-7, beta=0.05, gamma=0.03)
    model = assembled_model(system, [ModelDrive(name="x", hysteresis=stack)])
    result = modes(system, drives="in place", count=None)
    assert model.settled().deflections["x"].size == result.frequency_hz.size


@pytest.mark.parametrize(
    ("drives", "sensors", "message"),
    [
        ([], {}, "at least one drive"),
        ([ModelDrive(name="z", hysteresis=STACK)], {}, "no drive 'z'"),
        ([ModelDrive(name="x", hysteresis=STACK)], {"z": Sensor()}, "no probe 'z'"),
    ],
)
def test_a_model_that_cannot_be_is_refused(
    drives: list[ModelDrive], sensors: dict[str, Sensor], message: str
) -> None:
    with pytest.raises(ModelError, match=message):
        assembled_model(two_masses(0.013), drives, sensors=sensors)


def test_bad_commands_and_states_are_refused() -> None:
    model = whole_model()
    with pytest.raises(ModelError, match="same length"):
        model.simulate({"x": [1.0, 2.0], "y": [1.0]})
    with pytest.raises(ModelError, match="same length"):
        model.simulate({})
    with pytest.raises(ModelError, match="has no drive 'z'"):
        model.simulate({"z": [1.0]})
    drive = ModelDrive(name="x", hysteresis=STACK)
    other = assembled_model(model.system, [drive])
    with pytest.raises(ModelError, match="use a state that the model returned"):
        model.simulate({"x": [1.0]}, other.settled())
    rigid = dataclasses.replace(
        model.system,
        drives=(DrivePort(name="x", vector=np.array([1.0, 0.1]), stiffness=None),),
    )
    with pytest.raises(ModelError, match="is rigid"):
        assembled_model(rigid, [drive])
