"""Octave builds the exported Simulink models with stand-ins that check the calls, and runs them.

Evidence (Exported files): Simulink script in Octave, stand-in blocks (diagram; M, C, K; modes):
$10^{-8}$
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import block_diag, expm

from flexstage.export.control_object import linear_part
from flexstage.export.diagram.graph import (
    Block,
    BlockGroup,
    Diagram,
    SignalLine,
    diagram_state_space,
)
from flexstage.export.diagram.stage_diagram import drive_springs, fitted_damping, stage_diagram
from flexstage.export.simulink.files import simulink_files
from flexstage.hysteresis import Amplifier, BoucWen, DynamicModel, LogCreep, Sensor, dynamic_model
from flexstage.lumped import lumped_system
from flexstage.stage import Stage
from flexstage.stage.designs import design
from flexstage.system import MechanicalSystem
from tests.octave_program import OCTAVE
from tests.simulink_recording import Recording, build, octave, rebuilt, write

pytestmark = pytest.mark.skipif(OCTAVE is None, reason="GNU Octave is not installed")

# Drawing the two stages of the study takes seconds each.
STAGES = [
    "parallelogram",
    pytest.param("vgtu-piezo", marks=pytest.mark.slow),
    pytest.param("vgtu-mechanical", marks=pytest.mark.slow),
]
STOP = 0.01


class Built:
    """A stage, its files, and what Octave made of them."""

    def __init__(self, name: str, folder: Path) -> None:
        self.stage: Stage = design(name)
        self.system: MechanicalSystem = lumped_system(self.stage)
        # pure gains instead of hysteresis, so that all but rounding must agree
        self.model: DynamicModel = dynamic_model(self.stage, self.system, hysteresis="none")
        self.diagram = stage_diagram(self.stage, model=self.model)
        self.name = name.replace("-", "_")
        self.files = simulink_files(
            self.diagram, name=self.name, model=self.model, sample_time=1e-4, duration=STOP
        )
        self.made, self.ran = build(folder, self.files, self.name, stop=STOP)

    def commands(self) -> dict[str, np.ndarray]:
        """What the model is run with, by drive."""
        tables = {
            b.path.rsplit("/", 1)[1]: b.values["VariableName"]
            for b in self.made.blocks.values()
            if b.type == "FromWorkspace"
        }
        found = {}
        for block in (b for b in self.diagram.blocks if b.kind == "input"):
            table = tables[f"command_{block.name}"]
            drive = block.label.removeprefix("u_")
            found[drive] = np.interp(self.ran["t"], table[:, 0], table[:, 1])
        return found


_BUILT: dict[str, Built] = {}


@pytest.fixture(params=STAGES)
def built(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Built:
    name = request.param
    if name not in _BUILT:
        _BUILT[name] = Built(name, tmp_path_factory.mktemp("simulink"))
    return _BUILT[name]


def test_recorded_blocks_make_the_same_diagram(built: Built) -> None:
    again = rebuilt(built.made, built.name, built.diagram)
    mine = {b.name: b for b in built.diagram.blocks}
    theirs = {b.name: b for b in again.blocks}
    assert theirs.keys() == mine.keys()
    for name, block in mine.items():
        other = theirs[name]
        assert (other.kind, other.signs, other.width) == (block.kind, block.signs, block.width)
        if block.kind not in ("input", "output"):
            assert other.group == block.group, name
        if block.matrix is not None:
            assert other.matrix is not None
            # to the last bit: numbers go through a binary file
            assert np.array_equal(other.matrix, block.matrix), name

    def ends(diagram: Diagram) -> set[tuple[str, str, int]]:
        return {(w.source, w.target, w.port) for w in diagram.lines}

    assert ends(again) == ends(built.diagram)
    poles = [np.sort_complex(np.linalg.eigvals(diagram_state_space(d).A))
             for d in (again, built.diagram)]  # fmt: skip
    # the same numbers in another order of states: rounding of the eigenvalues only
    assert np.max(np.abs(poles[0] - poles[1])) < 1e-8 * np.max(np.abs(poles[1]))


def test_every_block_has_room_of_its_own(built: Built) -> None:
    by_system: dict[str, list[np.ndarray]] = {}
    for b in built.made.all_blocks.values():
        by_system.setdefault(b.path.rsplit("/", 1)[0], []).append(b.parameters["Position"])
    assert len(by_system) > 10
    for boxes in by_system.values():
        for i, a in enumerate(boxes):
            for b in boxes[:i]:
                apart = a[2] < b[0] or b[2] < a[0] or a[3] + 30 <= b[1] or b[3] + 30 <= a[1]
                # 30 pixels below a block hold its name and what it says
                assert apart, (a, b)


@pytest.mark.slow
def test_every_group_is_a_subsystem_that_says_what_it_is(built: Built) -> None:
    root = f"{built.name}/structure"
    for group in built.diagram.groups:
        system = built.made.all_blocks[f"{root}/{group.name}"]
        assert system.type == "SubSystem"
        assert system.parameters["Description"].split(";")[0]
    for b in built.made.blocks.values():
        assert b.parameters["Description"], b.path


def test_named_signals_carry_their_units(built: Built) -> None:
    bodies = [g for g in built.diagram.groups if g.kind == "body"]
    assert len([n for n in built.made.signals if n.startswith("q_") and n.endswith("rad]")]) >= len(
        bodies
    )


def test_modes_follow_the_dynamic_model(built: Built) -> None:
    # both are exact for commands of straight lines: what differs is rounding, mostly of the
    # exponential of a matrix with poles up to 1e6 1/s over 100 us
    expected = built.model.as_exported().simulate(built.commands()).readings
    for probe in built.model.probes:
        found = _reading(built, probe.name, modes=True)
        scale = np.max(np.abs(expected[probe.name]))
        assert scale > 0.0
        assert np.max(np.abs(found - expected[probe.name])) < 1e-8 * scale, probe.name


def test_structure_follows_mass_damping_and_stiffness(built: Built) -> None:
    # the matrices of Lagrange's equations, which the diagram was not made of, with the springs of
    # the drives in place; proportional damping in the hinges, the bodies and the elastic drives
    system, t = built.system, built.ran["t"]
    rayleigh, springs = fitted_damping(system), drive_springs(system)
    M, C, K = system.M, rayleigh.alpha * system.M + rayleigh.beta * system.K, system.K.copy()
    force = np.zeros((system.order, len(built.model.drives)))
    for j, d in enumerate(built.model.drives):
        port, spring = system.drive(d.name), springs[d.name]
        stiff = spring.stiffness * np.outer(port.vector, port.vector)
        K = K + stiff
        if not spring.replaces_imposed:
            C = C + rayleigh.beta * stiff
        force[:, j] = d.gain * (spring.stiffness or 1.0) * port.vector
    n, h = system.order, t[1] - t[0]
    A = np.block([[np.zeros((n, n)), np.eye(n)], [-np.linalg.solve(M, K), -np.linalg.solve(M, C)]])
    B = np.vstack((np.zeros_like(force), np.linalg.solve(M, force)))
    u = np.column_stack([built.commands()[d.name] for d in built.model.drives])
    x = _along_lines(A, B, u, h)
    for probe in system.probes:
        expected = x[:, :n] @ probe.vector
        found = _reading(built, probe.name, modes=False)
        assert np.max(np.abs(found - expected)) < 1e-8 * np.max(np.abs(expected)), probe.name


def _along_lines(A: np.ndarray, B: np.ndarray, u: np.ndarray, h: float) -> np.ndarray:
    """States under inputs of straight lines between samples, by one exponential."""
    n, m = B.shape
    step = expm(h * np.block([
        [A, B, np.zeros((n, m))],
        [np.zeros((m, n + m)), np.eye(m) / h],
        [np.zeros((m, n + 2 * m))],
    ]))  # fmt: skip
    x = np.zeros((len(u), n))
    for i in range(len(u) - 1):
        x[i + 1] = step[:n] @ np.concatenate((x[i], u[i], u[i + 1] - u[i]))
    return x


def _reading(built: Built, probe: str, *, modes: bool) -> np.ndarray:
    name = next(b.name for b in built.diagram.blocks if b.label == f"y_{probe}")
    return built.ran[f"{built.name}_{name}{'_modes' if modes else ''}"]


def test_model_is_saved_with_its_solver(built: Built) -> None:
    settings = built.made.settings
    assert settings["saved"].endswith(f"{built.name}.slx")
    assert settings["Solver"] in ("ode45", "ode15s")
    assert float(settings["StopTime"]) == STOP
    assert float(settings["AbsTol"]) <= 1e-12


# A body on a spring and a damper, behind a drive chain; every kind of block once.
MODEL = BoucWen(gain=0.593e-6, hysteresis_gain=0.241e-6, beta=0.05, gamma=0.03)
AMPLIFIER = Amplifier(
    bandwidth_hz=900.0,
    capacitance=1.7e-6,
    current_limit=0.05,
    voltage_range=(-10.0, 61.0),
    gain=1.1,
)
CREEP = LogCreep(rate_per_decade=0.013, shortest=0.002, longest=2.0)
SENSOR = Sensor(
    gain=1.03, offset=2.3e-7, bandwidth_hz=4100.0, quantisation=1e-12, mains_amplitude=3.1e-8,
    mains_phase=0.4, noise_rms=1e-9,
)  # fmt: skip
MASS, DAMPER, SPRING = 0.173, 11.3, 2.9e5


def small(*, limits: bool = True) -> Diagram:
    amplifier = AMPLIFIER if limits else replace(AMPLIFIER, current_limit=None, voltage_range=None)
    blocks = (
        Block(name="u", kind="input", label="u", meaning="the stage's command [V]"),
        Block(name="amp", kind="amplifier", label="amp", meaning="amplifier", group="drive",
              model=amplifier),
        Block(name="hys", kind="hysteresis", label="loop", meaning="stack", group="drive",
              model=MODEL),
        Block(name="slow", kind="creep", label="creep", meaning="creep", group="drive",
              model=CREEP),
        Block(name="force", kind="sum", label="", meaning="force [N]", signs=(1, -1, -1)),
        Block(name="k_drive", kind="gain", label="k", meaning="stiffness 100 % [N/m]",
              group="drive", matrix=np.array([[SPRING]])),
        Block(name="inverse_mass", kind="gain", label="1/m", meaning="one over mass [1/kg]",
              group="body", matrix=np.array([[1.0 / MASS]])),
        Block(name="rate", kind="integrator", label="1/s", meaning="rate [m/s]", group="body"),
        Block(name="place", kind="integrator", label="1/s", meaning="place [m]", group="body"),
        Block(name="d", kind="gain", label="d", meaning="damper [N s/m]", group="body",
              matrix=np.array([[DAMPER]])),
        Block(name="k", kind="gain", label="k", meaning="spring [N/m]", group="body",
              matrix=np.array([[SPRING]])),
        Block(name="minus", kind="sum", label="", meaning="turned round", signs=(-1,)),
        Block(name="eye", kind="sensor", label="sensor", meaning="sensor", model=SENSOR),
        Block(name="y", kind="output", label="y", meaning="reading [m]"),
        Block(name="v", kind="output", label="v", meaning="voltage [V]"),
        Block(name="w", kind="output", label="w", meaning="free displacement [m]"),
        Block(name="q", kind="output", label="q", meaning="place, turned round [m]"),
    )  # fmt: skip
    pairs = [
        ("u", "amp", 0), ("amp", "hys", 0), ("hys", "slow", 0), ("slow", "k_drive", 0),
        ("k_drive", "force", 0), ("d", "force", 1), ("k", "force", 2), ("force", "inverse_mass", 0),
        ("inverse_mass", "rate", 0), ("rate", "place", 0), ("rate", "d", 0), ("place", "k", 0),
        ("place", "eye", 0), ("place", "minus", 0), ("minus", "q", 0), ("eye", "y", 0),
        ("amp", "v", 0), ("hys", "w", 0),
    ]  # fmt: skip
    return Diagram(
        title="a 'small' stage: 100 %",
        blocks=blocks,
        lines=tuple(SignalLine(source=s, target=t, port=p, signal=f"{s} [1]") for s, t, p in pairs),
        groups=(BlockGroup(name="drive", title="the drive", kind="drive"),
                BlockGroup(name="body", title="body 1/2, moving", kind="body")),
        units={"u": "V", "y": "m", "v": "V", "w": "m", "q": "m"},
    )  # fmt: skip


STEP, END = 5e-5, 0.004


@pytest.fixture(scope="module")
def ran(tmp_path_factory: pytest.TempPathFactory) -> tuple[Recording, dict[str, np.ndarray]]:
    diagram = small()
    files = simulink_files(diagram, name="small", sample_time=STEP, duration=END)
    table = _data(files["small_data.mat"])["command_u"]
    # higher than usual, so that the amplifier meets its rate and the end of its range
    table[:, 1] *= 8.0
    files["small_data.mat"] = _with(files["small_data.mat"], command_u=table)
    return build(tmp_path_factory.mktemp("small"), files, "small", stop=END, parts=4)


def _data(content: bytes) -> dict[str, np.ndarray]:
    from io import BytesIO

    from scipy.io import loadmat

    return {k: v for k, v in loadmat(BytesIO(content)).items() if not k.startswith("__")}


def _with(content: bytes, **changed: np.ndarray) -> bytes:
    from io import BytesIO

    from scipy.io import savemat

    made = BytesIO()
    savemat(made, _data(content) | changed)
    return made.getvalue()


def test_small_diagram_is_rebuilt_with_its_chain(
    ran: tuple[Recording, dict[str, np.ndarray]],
) -> None:
    again, mine = rebuilt(ran[0], "small", small()), small()
    assert {b.name: (b.kind, b.signs, b.group) for b in again.blocks} == {
        b.name: (b.kind, b.signs, "" if b.kind in ("input", "output") else b.group)
        for b in mine.blocks
    }
    assert {(w.source, w.target, w.port) for w in again.lines} == {
        (w.source, w.target, w.port) for w in mine.lines
    }


def test_amplifier_of_blocks_slews_and_rests_at_its_ends(
    ran: tuple[Recording, dict[str, np.ndarray]],
) -> None:
    t, v = ran[1]["t"], ran[1]["small_v"]
    command = 40.0 * (1.0 - np.cos(2.0 * np.pi * t / END))
    fine = np.interp(t, *_command_knots(command.max() / 2.0))
    expected = AMPLIFIER.simulate(fine, STEP, AMPLIFIER.settled(0.0, STEP)).values
    assert v.max() == 61.0
    assert np.max(np.diff(v)) > 0.999 * AMPLIFIER.largest_rate * STEP
    # steps of 12.5 us go across the corners where the rate is let go: 7e-4 V was seen, of the size
    # of (12.5 us)^2 (3e4 V/s)/(2 177 us)
    assert np.max(np.abs(v - expected)) < 5e-3


def _command_knots(half: float) -> tuple[np.ndarray, np.ndarray]:
    time = np.linspace(0.0, END, 401)
    return time, half * (1.0 - np.cos(2.0 * np.pi * time / END))


def test_hysteresis_block_remembers_as_the_model_does(
    ran: tuple[Recording, dict[str, np.ndarray]],
) -> None:
    expected = MODEL.simulate(ran[1]["small_v"]).values
    stroke = np.ptp(expected)
    assert np.max(np.abs(ran[1]["small_w"] - expected)) < 1e-12 * stroke


def test_creep_body_and_sensor_follow_the_held_hysteresis(
    ran: tuple[Recording, dict[str, np.ndarray]],
) -> None:
    t, w = ran[1]["t"], ran[1]["small_w"]
    # states: lags, place, rate, lag of the sensor; the input w is held between samples
    rate, a = 1.0 / CREEP.time_constants, CREEP.lag_gain
    m, tau = rate.size, 2.0 * np.pi * 4100.0
    A = block_diag(-np.diag(rate), [[0.0, 1.0], [-SPRING / MASS, -DAMPER / MASS]], [[-tau]])
    A[m + 1, :m] = a * SPRING / MASS
    A[m + 2, m] = tau
    B = np.concatenate((rate, [0.0, SPRING / MASS, 0.0]))[:, None]
    n = m + 3
    step = expm(STEP * np.block([[A, B], [np.zeros((1, n + 1))]]))
    x = np.zeros((t.size, n))
    for i in range(t.size - 1):
        x[i + 1] = step[:n] @ np.append(x[i], w[i])
    place, seen = x[:, m], x[:, m + 2]
    mains = 3.1e-8 * np.sin(2.0 * np.pi * 50.0 * t + 0.4)
    reading = 1.03 * seen + 2.3e-7 + mains
    scale = np.max(np.abs(place))
    # four steps of the fourth order a sample: (tau h/4)^5/120 = 3e-5 of what the lag at 4.1 kHz is
    # behind, which is about 1e-3; the body is 20 times slower
    assert np.max(np.abs(ran[1]["small_q"] + place)) < 1e-8 * scale
    assert np.max(np.abs(ran[1]["small_y"] - reading)) < 3e-7 * scale


def _two_gains() -> Diagram:
    """The least diagram with the inputs and outputs of the piezo stage."""
    blocks = [
        block
        for axis in "xy"
        for block in (
            Block(name=f"u{axis}", kind="input", label=f"u_{axis}", meaning="command [V]"),
            Block(name=f"g{axis}", kind="gain", label="g", meaning="gain [m/V]",
                  matrix=np.array([[1e-7]])),
            Block(name=f"y{axis}", kind="output", label=f"y_{axis}", meaning="reading [m]"),
        )
    ]  # fmt: skip
    lines = [
        line
        for axis in "xy"
        for line in (
            SignalLine(source=f"u{axis}", target=f"g{axis}"),
            SignalLine(source=f"g{axis}", target=f"y{axis}"),
        )
    ]
    units = {"ux": "V", "uy": "V", "yx": "m", "yy": "m"}
    return Diagram(title="gains", blocks=tuple(blocks), lines=tuple(lines), units=units)


def _chained(step: float) -> DynamicModel:
    stage = design("vgtu-piezo")
    return dynamic_model(
        stage,
        lumped_system(stage),
        time_step=step,
        hysteresis={"x": MODEL, "y": replace(MODEL, beta=0.04)},
        creep=CREEP,
        sensors={"y": Sensor(gain=0.97, bandwidth_hz=730.0)},
        keep_modes=3,
    )


def _run_modes(folder: Path, step: float) -> tuple[dict[str, np.ndarray], DynamicModel]:
    model = _chained(step)
    files = simulink_files(_two_gains(), name="chain", model=model, sample_time=step, duration=0.04)
    folder.mkdir()
    return build(folder, files, "chain", stop=0.02)[1], model


@pytest.fixture(scope="module")
def chained(tmp_path_factory: pytest.TempPathFactory) -> tuple[dict[str, np.ndarray], DynamicModel]:
    return _run_modes(tmp_path_factory.mktemp("chain") / "model", 1e-4)


def test_modes_behind_hysteresis_creep_and_sensor(
    chained: tuple[dict[str, np.ndarray], DynamicModel],
) -> None:
    ran, model = chained
    t = ran["t"]
    u = 0.5 * 0.75 * 120.0 * (1.0 - np.cos(2.0 * np.pi * np.linspace(0.0, 0.04, 401) / 0.04))
    u = np.interp(t, np.linspace(0.0, 0.04, 401), u)
    form = linear_part(model)
    loops = [d.hysteresis for d in model.drives]
    w = np.column_stack([loop.simulate(u).values for loop in loops if loop is not None])
    # with the lag of the sensor of y; w is held from sample to sample
    n, pole = form.A.shape[0], 2.0 * np.pi * 730.0
    A = block_diag(form.A, [[-pole]])
    A[n, :n] = pole * form.C[1]
    B = np.vstack((form.B, pole * form.D[1]))
    step = expm(1e-4 * np.block([[A, B], [np.zeros((2, n + 3))]]))
    x = np.zeros((t.size, n + 1))
    for i in range(t.size - 1):
        x[i + 1] = step[: n + 1] @ np.concatenate((x[i], w[i]))
    expected = {
        "chain_yx_modes": x[:, :n] @ form.C[0] + w @ form.D[0],
        "chain_yy_modes": 0.97 * x[:, n],
    }
    for name, values in expected.items():
        assert np.max(np.abs(ran[name] - values)) < 1e-10 * np.max(np.abs(values)), name
    assert np.allclose(ran["chain_yx"], 1e-7 * u, rtol=1e-14, atol=0.0)


def test_held_hysteresis_comes_to_the_dynamic_model_with_its_samples(
    chained: tuple[dict[str, np.ndarray], DynamicModel], tmp_path: Path
) -> None:
    # the model knows the output between the samples; a held one is half a sample late, so that
    # half the samples double the error
    missed = []
    for ran, model in (_run_modes(tmp_path / "coarse", 2e-4), chained):
        step = model.step
        knots = np.linspace(0.0, 0.04, 401)
        u = 0.5 * 0.75 * 120.0 * (1.0 - np.cos(2.0 * np.pi * knots / 0.04))
        u = np.interp(ran["t"], knots, u)
        exact = model.as_exported().simulate({"x": u, "y": u}).readings
        late = ran["chain_yx_modes"] - exact["x"]
        missed.append(float(np.max(np.abs(late))))
        rate = np.gradient(exact["x"], ran["t"])
        # slow motion: what is missed is half a sample of it
        assert np.max(np.abs(late + 0.5 * step * rate)) < 0.1 * np.max(np.abs(late))
    assert 1.9 < missed[0] / missed[1] < 2.1


@pytest.mark.parametrize("axis", [None, "x"])
def test_drawings_for_people_are_built_too(axis: str | None, tmp_path: Path) -> None:
    # mirror images drawn once, and one axis as two masses
    diagram = stage_diagram(design("parallelogram" if axis is None else "vgtu-piezo"), axis=axis)
    made, _ = build(tmp_path, simulink_files(diagram, name="drawn"), "drawn")
    again = rebuilt(made, "drawn", diagram)
    matrices = {b.name: b.matrix for b in again.blocks if b.matrix is not None}
    for b in diagram.blocks:
        if b.matrix is not None:
            assert np.array_equal(matrices.pop(b.name), b.matrix), b.name
    assert not matrices
    assert {(w.source, w.target, w.port) for w in again.lines} == {
        (w.source, w.target, w.port) for w in diagram.lines
    }


def test_script_refuses_what_is_open_missing_or_half_there(tmp_path: Path) -> None:
    files = simulink_files(small(), name="small")
    write(tmp_path, files)
    trials = """
    function said = tried()
      said = '';
      try, small_build(); catch problem, said = problem.message; end
      said = sprintf('%s|%d\\n', said, bdIsLoaded('small'));
    end
    """
    (tmp_path / "tried.m").write_text(trials)
    code = """
    rename('small_data.mat', 'away.mat'); printf('%s', tried());
    rename('away.mat', 'small_data.mat');
    rename('small_hysteresis_hys.m', 'away.txt'); printf('%s', tried());
    rename('away.txt', 'small_hysteresis_hys.m'); printf('%s', tried());
    printf('%s', tried());
    close_system('small', 0);
    small_build();
    """
    done = octave(tmp_path, code)
    assert done.returncode == 0, done.stderr
    no_data, no_function, good, open_already = done.stdout.splitlines()
    assert "small_data.mat is missing" in no_data
    assert no_data.endswith("|0")
    # nothing half-built stays open
    assert "small_hysteresis_hys.m is missing" in no_function
    assert no_function.endswith("|0")
    assert good == "|1"
    assert "A model named small is open" in open_already
    assert "small is built but not saved" in done.stderr


def test_script_says_that_simulink_is_missing(tmp_path: Path) -> None:
    write(tmp_path, simulink_files(small(), name="small"))
    done = octave(tmp_path, f"rmpath('{Path(__file__).parents[1] / 'octave'}'); small_build();")
    assert done.returncode == 1
    assert "Simulink is not installed: " in done.stderr


@pytest.mark.parametrize(
    ("there", "wrong", "said"),
    [
        ("'Multiplication', ", "'Multiply', ", "does not have a parameter"),
        ("Matrix(K*u) (u vector)", "Matrix(K*u) (vector)", "is no value of"),
        ("simulink/Math Operations/Gain", "simulink/Math/Gain", "there is no block"),
        ("'place/1', 'k/1'", "'place/2', 'k/1'", "has no port 2"),
        ("'place/1', 'k/1'", "'place/1', 'd/1'", "has already a line"),
        ("wire(at, 'place/1', 'k/1'", "% wire(at, 'place/1', 'k/1'", "is not connected"),
        ("'Gain', 'k_drive'", "'Gain', 'k_driven'", "undefined"),
    ],
)
def test_stand_ins_see_what_simulink_would(
    there: str, wrong: str, said: str, tmp_path: Path
) -> None:
    files = simulink_files(small(), name="small")
    script = files["small_build.m"].decode()
    assert there in script
    files["small_build.m"] = script.replace(there, wrong, 1).encode()
    write(tmp_path, files)
    done = octave(tmp_path, "small_build(); simulink_record('recorded.mat');")
    assert done.returncode == 1
    assert said in done.stderr
