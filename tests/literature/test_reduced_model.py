r"""The reduced model of a stage as other programs read it, and super-elements of others on it.

Evidence (Exported files): reduced model with interface frames, ground held: frequencies in SciPy,
Octave and from OUTPUT4 text $10^{-9}$, in EXUDYN $10^{-6}$; free: six rigid modes, mass in closed
form $2\times10^{-5}$; a flexure by Ansys on the platform: statics in series $10^{-5}$
"""

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.io import loadmat, savemat
from scipy.linalg import eigh
from scipy.sparse import csc_array

from flexstage.base.errors import FlexstageError
from flexstage.cli import main
from flexstage.export.reduced import (
    Superelement,
    joined,
    op4_text,
    read_reduced,
    reduced_files,
    reduced_model,
)
from flexstage.fem import superelement_model
from flexstage.fem.mesh import MeshSettings
from flexstage.fem.superelement import SuperelementModel
from flexstage.stage import Circle, Stage, mass_properties
from flexstage.stage.contour import body_contour
from flexstage.stage.file import write_stage
from flexstage.system import modes
from tests.hinged_bars import hinged_bars
from tests.octave_program import OCTAVE, run_octave
from tests.shared_data import DATA, needs

STAGE = hinged_bars()
MODES = 12  # that are compared


@pytest.fixture(scope="module")
def source() -> SuperelementModel:
    return superelement_model(STAGE, MeshSettings(order=2, neck_size=1.2), space=True, cache=False)


@pytest.fixture(scope="module")
def model(source: SuperelementModel) -> Superelement:
    return reduced_model(source)


@pytest.fixture(scope="module")
def folder(model: Superelement, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("reduced")
    for name, content in reduced_files(model).items():
        (folder / name).write_bytes(content)
    return folder


@pytest.fixture(scope="module")
def ours(source: SuperelementModel) -> np.ndarray:
    """Frequencies of the stage with its ground held [Hz]."""
    return modes(source.system, count=MODES).frequency_hz


def held(K: np.ndarray, M: np.ndarray) -> np.ndarray:
    """Return the lowest frequencies with the first frame held [Hz]."""
    squares = eigh(K[6:, 6:], M[6:, 6:], eigvals_only=True)
    return np.sqrt(squares[:MODES]) / (2.0 * math.pi)


def rigid(P: np.ndarray, size: int) -> np.ndarray:
    """Return the rigid motions about the origin in the coordinates, shape (size, 6)."""
    motion = np.zeros((size, 6))
    for k, (x, y, z) in enumerate(P):
        motion[6 * k : 6 * k + 6] = np.eye(6)
        motion[6 * k : 6 * k + 3, 3:] = [[0, z, -y], [-z, 0, x], [y, -x, 0]]
    return motion


def product_of_inertia() -> float:
    """Return the integral of x y over the mass of the stage, by polygons."""
    mounted = STAGE.body("standing").extra_masses[0]
    total = mounted.mass * mounted.at[0] * mounted.at[1]
    for body in STAGE.bodies:
        outline, holes = body_contour(STAGE, body)
        for sign, shape in [(1.0, outline), *((-1.0, h) for h in (*holes, *body.mounting_holes))]:
            loop = shape.loop() if isinstance(shape, Circle) else shape
            x, y = loop.polyline(1e-7).T
            u, v = np.roll(x, -1), np.roll(y, -1)
            turned = x * v - u * y
            product = float(turned @ (x * v + 2.0 * x * y + 2.0 * u * v + u * y)) / 24.0
            area = float(turned.sum()) / 2.0
            surface = STAGE.thickness * STAGE.material.density
            total += sign * surface * product * math.copysign(1.0, area)
    return total


def read_op4(text: str) -> dict[str, np.ndarray]:
    """Read dense real OUTPUT4 text, column by column, as its header says."""
    lines = iter(text.splitlines())
    matrices = {}
    for header in lines:
        columns, rows, _, kind = (int(header[i : i + 8]) for i in (0, 8, 16, 24))
        assert kind == 2
        per_line, width = (int(w.split(".")[0]) for w in header[43:].split("E"))
        matrix = matrices[header[32:40].strip()] = np.zeros((rows, columns))
        while True:
            line = next(lines)
            column, first, count = (int(line[i : i + 8]) for i in (0, 8, 16))
            words = []
            while len(words) < count:
                line = next(lines)
                words += [line[i : i + width] for i in range(0, len(line), width)]
                assert len(line) <= width * per_line <= 80
            if column > columns:
                break
            matrix[first - 1 : first - 1 + count, column - 1] = [float(w) for w in words]
    return matrices


def test_frequencies_with_the_ground_held(
    folder: Path, model: Superelement, ours: np.ndarray, tmp_path: Path
) -> None:
    data: dict[str, Any] = loadmat(folder / "hinged-bars-reduced.mat")
    assert held(data["K"], data["M"]) == pytest.approx(ours, rel=1e-9)
    assert [str(name[0]) for name in data["frames"].ravel()] == list(model.frames)
    assert len(data["coordinates"]) == len(data["K"]) == len(model.coordinates)
    # damping of 1 % in each mode
    squares, shapes = eigh(data["K"][6:, 6:], data["M"][6:, 6:])
    damping = shapes.T @ data["C"][6:, 6:] @ shapes
    np.testing.assert_allclose(damping, np.diag(0.02 * np.sqrt(squares)), atol=1e-6 * damping.max())
    again = read_reduced(folder / "hinged-bars-reduced.mat")
    assert again.frames == model.frames
    np.testing.assert_array_equal(again.M, model.M)
    sparse = {name: csc_array(data[name]) for name in "KMC"}
    savemat(tmp_path / "sparse.mat", {"P": model.P} | sparse)
    np.testing.assert_array_equal(read_reduced(tmp_path / "sparse.mat").K, model.K)


def test_nastran_text_has_the_same_matrices(folder: Path, model: Superelement) -> None:
    found = read_op4((folder / "hinged-bars-reduced.op4").read_text("ascii"))
    assert list(found) == ["KAAX", "MAAX", "BAAX", "PAAX"]
    for name, matrix in zip(found, (model.K, model.M, model.C, model.P), strict=True):
        np.testing.assert_array_equal(found[name], matrix)
    # the smallest numbers keep the width; empty columns are left out
    hard = np.array([[0.0, -1e-300], [0.0, 1.0 / 3.0]])
    np.testing.assert_array_equal(read_op4(op4_text({"A": hard}))["A"], hard)


@pytest.mark.skipif(OCTAVE is None, reason="Octave is not installed")
def test_octave_finds_the_frequencies(folder: Path, ours: np.ndarray) -> None:
    done = run_octave(
        folder,
        "S = load('hinged-bars-reduced.mat'); k = 7:rows(S.K);\n"
        "printf('%.12g\\n', sort(sqrt(eig(S.K(k, k), S.M(k, k)))) / 2 / pi);",
    )
    assert done.returncode == 0, done.stderr[-2000:]
    found = [float(word) for word in done.stdout.split()[:MODES]]
    assert found == pytest.approx(ours, rel=1e-9)


def test_exudyn_finds_the_frequencies(folder: Path, ours: np.ndarray) -> None:
    """The ground is held by constraints of EXUDYN, on each of its six coordinates."""
    exudyn = pytest.importorskip("exudyn", reason="EXUDYN is not installed")
    from exudyn import itemInterface as item  # noqa: N813

    data = loadmat(folder / "hinged-bars-reduced.mat")
    size = len(data["K"])
    container = exudyn.SystemContainer()
    system = container.AddSystem()
    zero = np.zeros(size)
    node = system.AddNode(
        item.NodeGenericODE2(
            numberOfODE2Coordinates=size,
            referenceCoordinates=zero,
            initialCoordinates=zero,
            initialCoordinates_t=zero,
        )
    )
    system.AddObject(
        item.ObjectGenericODE2(
            nodeNumbers=[node],
            massMatrix=data["M"],
            stiffnessMatrix=data["K"],
            dampingMatrix=data["C"],
        )
    )
    ground = system.AddNode(item.NodePointGround())
    fixed = system.AddMarker(item.MarkerNodeCoordinate(nodeNumber=ground, coordinate=0))
    for k in range(6):
        moved = system.AddMarker(item.MarkerNodeCoordinate(nodeNumber=node, coordinate=k))
        system.AddObject(item.CoordinateConstraint(markerNumbers=[fixed, moved]))
    system.Assemble()
    found, _ = system.ComputeODE2Eigenvalues(convert2Frequencies=True)
    # EXUDYN's stiffness is a numerical difference
    assert np.sort(found)[:MODES] == pytest.approx(ours, rel=1e-6)


def test_the_free_stage_has_six_rigid_modes_and_its_mass(model: Superelement) -> None:
    motion = rigid(model.P, len(model.K))
    assert np.abs(model.K @ motion).max() < 1e-12 * np.abs(model.K).max()
    assert np.abs(model.C @ motion).max() < 1e-12 * np.abs(model.C).max()
    squares = eigh(model.K, model.M, eigvals_only=True)
    assert np.abs(squares[:6]).max() < 1e-6 * squares[6]
    inertia = motion.T @ model.M @ motion
    # closed forms of areas; the mesh has its arcs in few elements
    bodies = mass_properties(STAGE).values()
    mass = sum(b.mass for b in bodies)
    x, y = (sum(b.mass * b.centre[i] for b in bodies) / mass for i in (0, 1))
    polar = sum(b.inertia + b.mass * (b.centre[0] ** 2 + b.centre[1] ** 2) for b in bodies)
    mounted = STAGE.body("standing").extra_masses[0]
    across = (mass - mounted.mass) * STAGE.thickness**2 / 12.0 - mounted.inertia / 2.0
    assert np.diag(inertia)[:3] == pytest.approx(mass, rel=2e-5)
    assert inertia[1, 5] == pytest.approx(mass * x, rel=3e-5)
    assert inertia[0, 5] == pytest.approx(-mass * y, rel=3e-5)
    assert inertia[2, 3] == pytest.approx(mass * y, rel=3e-5)
    assert inertia[2, 4] == pytest.approx(-mass * x, rel=3e-5)
    assert inertia[5, 5] == pytest.approx(polar, rel=3e-5)
    assert inertia[3, 4] == pytest.approx(-product_of_inertia(), rel=1e-4)
    # of a plate: about x and y together as about z, with the thickness twice; the mounted mass is a
    # point out of the plane
    assert inertia[3, 3] + inertia[4, 4] == pytest.approx(polar + 2.0 * across, rel=3e-5)


def test_statics_of_forces_weight_and_drive(model: Superelement, source: SuperelementModel) -> None:
    system = source.system
    compliance = np.linalg.inv(model.K[6:, 6:])
    # the drive acts upwards on the third frame, on the patch
    push = system.drive("push").vector
    assert compliance[7, 7] == pytest.approx(push @ np.linalg.solve(system.K, push), rel=1e-9)
    # seen from a ground that accelerates by -g, all that stands on it has its weight
    motion = rigid(model.P, len(model.K))
    x, y = np.array(STAGE.probes[0].at) - model.P[1, :2]
    for direction, name in ((0, "gravity x"), (1, "gravity y"), (2, "gravity z")):
        u = (compliance @ (9.80665 * model.M @ motion)[6:, direction])[:6]
        response = np.linalg.solve(system.K, system.load(name).vector)
        if name == "gravity z":
            found = u[2] + y * u[3] - x * u[4]  # of the point of the probe
            expected = system.probe("standing out of plane").vector @ response
        else:
            found, expected = u[[0, 1, 5]], system.body("standing").matrix @ response
        assert found == pytest.approx(expected, rel=1e-5)


@needs("ansys-flexures")
def test_a_joint_by_ansys_on_the_platform(model: Superelement) -> None:
    """Its lower end is on the platform; statics of its upper end are those of both in series."""
    joint = read_reduced(DATA / "ansys-flexures/flexor_025.mat")
    turn = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])  # z along -y
    both = joined(model, joint, ("standing", "frame 2"), turn)
    assert both.frames == (*model.frames, "flexor_025 frame 1")
    arm = both.P[3] - both.P[1]
    np.testing.assert_allclose(arm, turn @ (joint.P[0] - joint.P[1]), atol=1e-12)
    motion = rigid(both.P, len(both.K))
    # the super-element has rigid modes to the digits of its file
    assert np.abs(both.K @ motion).max() < 1e-6 * np.abs(both.K).max()
    mass = (motion.T @ both.M @ motion)[0, 0]
    alone = rigid(model.P, len(model.K))
    assert mass == pytest.approx((alone.T @ model.M @ alone)[0, 0] + 29.22e-3, rel=1e-4)
    found = np.linalg.inv(both.K[6:, 6:])[18 - 6 : 24 - 6, 18 - 6 : 24 - 6]
    platform = np.linalg.inv(model.K[6:, 6:])[:6, :6]
    own = np.delete(np.delete(joint.K, range(6, 12), 0), range(6, 12), 1)
    turned = np.kron(np.eye(2), turn)
    carried = rigid(arm[None], 6)
    expected = carried @ platform @ carried.T + turned @ np.linalg.inv(own)[:6, :6] @ turned.T
    size = 1.0 / np.sqrt(np.diag(expected))
    np.testing.assert_allclose(
        found * np.outer(size, size), expected * np.outer(size, size), atol=1e-5
    )


@needs("ansys-flexures")
def test_an_actuator_by_ansys_has_its_frames() -> None:
    actuator = read_reduced(DATA / "ansys-flexures/APA300ML.mat")
    assert len(actuator.frames) == len(actuator.P) == 7
    assert len(actuator.K) - 6 * 7 == sum("mode" in name for name in actuator.coordinates)


def test_the_command_writes_the_files(
    folder: Path,
    source: SuperelementModel,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """By superelements in space, here those of the other tests, whatever the model."""
    asked = []

    def made(stage: Stage, *, space: bool) -> SuperelementModel:
        asked.append((stage, space))
        return source

    monkeypatch.setattr("flexstage.export.reduced.superelement_model", made)
    file = tmp_path / "bars.yaml"
    write_stage(STAGE, file)
    out = tmp_path / "out"
    with pytest.raises(SystemExit) as end:
        main(["export", str(file), "--to", "reduced", "--folder", str(out), "--json"])
    assert not end.value.code
    assert [(stage.name, space) for stage, space in asked] == [(STAGE.name, True)]
    assert {p.name: p.read_bytes() for p in out.iterdir()} == {
        p.name: p.read_bytes() for p in folder.glob("*-reduced.*")
    }
    notes = json.loads(capsys.readouterr().out)["notes"]
    assert "Drive 'push' stands on the ground." in notes


def test_what_does_not_fit_is_refused(
    model: Superelement, source: SuperelementModel, tmp_path: Path
) -> None:
    file = tmp_path / "other.mat"
    for variables, said in (
        ({"A": np.eye(2)}, "must have P"),
        ({"P": np.zeros((2, 3)), "K": np.eye(12), "M": np.eye(11)}, "square K, M and C"),
        ({"P": np.zeros((3, 2)), "K": np.eye(18), "M": np.eye(18)}, "P of n rows of 3"),
        (
            {"P": np.zeros((1, 3)), "K": np.eye(6), "M": np.eye(6), "frames": ["base", "tip "]},
            "2 names of frames for 1 rows",
        ),
    ):
        savemat(file, variables)
        with pytest.raises(FlexstageError, match=said):
            read_reduced(file)
    file.write_text("no matrices")
    with pytest.raises(FlexstageError, match="save it as level 5"):
        read_reduced(file)
    with pytest.raises(FlexstageError, match="no frame 'tip': choose from ground, standing"):
        joined(model, model, ("ground", "tip"))
    both = joined(model, model, ("standing", "ground"))
    with pytest.raises(FlexstageError, match=rf"already has a frame '{model.name} standing'"):
        joined(both, model, ("ground", "ground"))
    second = joined(both, replace(model, name="second"), ("ground", "ground"))
    assert len(set(second.frames)) == len(second.P) == len(model.P) + 2 * (len(model.P) - 1)
    with pytest.raises(FlexstageError, match="matrix of a rotation"):
        joined(model, model, ("standing", "ground"), np.diag([1.0, 1.0, -1.0]))
    count = len(STAGE.bodies)  # those that move in the plane come first
    plane = replace(source, placed=source.placed[:count], condensed=source.condensed[:count])
    with pytest.raises(FlexstageError, match="superelements in space"):
        reduced_model(plane)
