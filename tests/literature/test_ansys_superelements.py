"""Two flexure joints and an amplified actuator against super-elements that Ansys made of them.

The super-elements (K, M, interface nodes) and the STEP files are those of T. Dehaeze's nano-hexapod
(github.com/tdehaeze/stewart-simscape, MIT). Their materials are not stated: they are inferred from
mass over volume. docs/explanation/ansys-comparison.md shows the figures and explains the
differences; `pytest -m evidence --log-cli-level=INFO` with this file writes them.

Evidence (Finite elements): notched joint ([Ansys
super-element](../explanation/ansys-comparison.md)): 1 %, bending, axial and modes 0.5 %; actuator,
pocket unknown: mass $10^{-3}$, ratio 1 %, stack ends 8 % [*evidence*, actuator *slow*]
"""

import json
import logging
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.io
import scipy.linalg
import scipy.optimize
from netgen import occ

from flexstage.cli import main
from flexstage.elasticity import Continuum
from flexstage.fem.interface import interface_modes, interface_motion, interface_stiffness
from flexstage.fem.part import Part, read_step
from flexstage.fem.part_analysis import Bodies
from flexstage.fem.part_mesh import PartMesh
from flexstage.quantities.material import Material
from tests.shared_data import DATA, needs

FOLDER = DATA / "ansys-flexures"
pytestmark = needs("ansys-flexures")

# Ansys' library: "Stainless Steel" and "Structural Steel". Which was used follows from the density.
STAINLESS = Material(
    name="stainless", youngs_modulus=193e9, poissons_ratio=0.31, density=7750.0, source="inferred"
)
STRUCTURAL = Material(
    name="structural", youngs_modulus=200e9, poissons_ratio=0.30, density=7850.0, source="inferred"
)
HERTZ = 2.0 * math.pi
LOG = logging.getLogger(__name__)


# ------------------------------------------------------------------ the super-elements


def superelement(name: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return K, M and the interface nodes [m]: 6 degrees of freedom a node, then modes."""
    data: dict[str, Any] = scipy.io.loadmat(FOLDER / f"{name}.mat")
    return data["K"], data["M"], data["int_xyz"]


def frequencies(K: np.ndarray, M: np.ndarray) -> np.ndarray:
    values = scipy.linalg.eigh(K, M, eigvals_only=True)
    return np.sqrt(np.abs(values)) / HERTZ


def rigid_mass(M: np.ndarray, nodes: np.ndarray) -> np.ndarray:
    """Return the 6 x 6 inertia about the origin."""
    motion = np.zeros((len(M), 6))
    for k, (x, y, z) in enumerate(nodes):
        motion[6 * k : 6 * k + 6] = np.eye(6)
        motion[6 * k : 6 * k + 3, 3:] = [[0, z, -y], [-z, 0, x], [y, -x, 0]]
    return motion.T @ M @ motion


def pushed_apart(K: np.ndarray, a: int, b: int) -> np.ndarray:
    """Return the motion under a pair of unit forces that push node a along x and b against it."""
    load = np.zeros(len(K))
    load[6 * a], load[6 * b] = 1.0, -1.0
    u = np.zeros(len(K))
    u[6:] = np.linalg.solve(K[6:, 6:], load[6:])
    return u


def stacks(K: np.ndarray) -> tuple[list[float], float]:
    """Return the stiffness of the four pieces between the shell's ends, and of the shell alone.

    A pair of forces on a piece works against the piece and, through the others, against the shell:
    k_measured = k + k_shell d_ends / d_piece. The shell's is found so that the four in series and
    the shell are as stiff together as the ends are.
    """
    u = pushed_apart(K, 6, 2)
    ends = 1.0 / (u[36] - u[12])
    pieces = []
    for a, b in ((3, 2), (4, 3), (5, 4), (6, 5)):
        u = pushed_apart(K, a, b)
        apart = u[6 * a] - u[6 * b]
        pieces.append((1.0 / apart, (u[36] - u[12]) / apart))

    def series(shell: float) -> float:
        return 1.0 / sum(1.0 / (k - shell * r) for k, r in pieces)

    shell: Any = scipy.optimize.brentq(lambda s: series(s) + s - ends, 0.0, 0.3 * ends)
    return [k - shell * r for k, r in pieces], float(shell)


def test_superelements_say_what_their_author_prints():
    # T. Dehaeze prints these to three or four digits; 1e-3 is their rounding
    K, M, nodes = superelement("flexor_025")
    assert np.diag(K[6:12, 6:12]) == pytest.approx(
        [12.705e6, 12.706e6, 93.955e6, 4.8322, 4.8284, 260.18], rel=1e-4
    )
    assert rigid_mass(M[:12, :12], nodes)[0, 0] == pytest.approx(29.22e-3, rel=1e-3)
    assert frequencies(K, M)[6:8] == pytest.approx([992.9, 992.9], rel=1e-3)
    K, M, nodes = superelement("APA300ML")
    compliance = np.linalg.inv(K[6:, 6:])
    assert 1.0 / compliance[2, 2] == pytest.approx(1.753e6, rel=1e-3)
    u = pushed_apart(K, 6, 2)
    assert -u[8] / (u[36] - u[12]) == pytest.approx(5.07, rel=2e-3)
    assert 1.0 / (u[36] - u[12]) == pytest.approx(83.1e6, rel=1e-3)
    assert frequencies(K[6:, 6:], M[6:, 6:])[:3] == pytest.approx([294.6, 525.2, 709.4], rel=1e-3)
    assert rigid_mass(M[:42, :42], nodes)[0, 0] == pytest.approx(115.3e-3, rel=1e-3)


def test_interfaces_of_the_superelements_are_deformable():
    # A rigid cross-section of the stack would hide the piece before it from the piece behind it, as
    # nothing but the stack leads there: their stiffness would be 0. It is 3.5 % of a neighbour's.
    K, _, _ = superelement("APA300ML")
    neighbours = abs(K[6 * 2, 6 * 3])
    for a, b in ((2, 4), (3, 5)):
        assert abs(K[6 * a, 6 * b]) > 0.02 * neighbours


# ------------------------------------------------------------------ geometry


def joint(name: str) -> tuple[Part, str, str]:
    part = read_step(FOLDER / name)
    (_, _, low), (_, _, high) = part.bounding_box
    if name.startswith("flexor_025"):
        # each end is three faces: the middle one is the body's, those beside it belong to the
        # stops of the other body
        names = [part.face_at((0.0, 0.0, z)) for z in (high, low)]
        return part, part.boundary(names[0]), part.boundary(names[1])
    return part, part.boundary(part.select("z", "max")), part.boundary(part.select("z", "min"))


def test_mass_and_inertia_tell_the_material():
    _, M, nodes = superelement("flexor_025")
    inertia = rigid_mass(M[:12, :12], nodes)
    part, _, _ = joint("flexor_025.step")
    # 7750 kg/m^3 to 0.01 %: volume and mass agree to the digits that the file has
    assert inertia[0, 0] / part.volume == pytest.approx(STAINLESS.density, rel=1e-4)
    _, M, nodes = superelement("flexor_ID16")
    mass = rigid_mass(M[:12, :12], nodes)[0, 0]
    part, _, _ = joint("flexor_ID16.STEP")
    # No steel has 8450 kg/m^3. With the two threaded holes filled it comes near that of structural
    # steel, and the centre of mass, which knows no density, where it is in the super-element.
    whole = filled(part)
    assert mass / part.volume == pytest.approx(8453.0, rel=1e-3)
    assert mass / whole.volume == pytest.approx(STRUCTURAL.density, rel=0.01)
    centre = rigid_mass(M[:12, :12], nodes)[0, 4] / mass
    assert whole.shape.solids[0].center.z * 1e-3 == pytest.approx(centre, abs=0.05e-3)
    assert part.shape.solids[0].center.z * 1e-3 > centre + 0.25e-3


def filled(part: Part) -> Part:
    """Return the ID16 joint without its two threaded holes, counterbore kept."""
    low = occ.Cylinder((0, 0, -18), occ.Z, 2.5, 12.6)
    high = occ.Cylinder((0, 0, 9), occ.Z, 2, 13)
    return Part.from_shape((part.shape + low + high).solids[0], source="ID16 without holes")


# ------------------------------------------------------------------ joints by finite elements


def report(what: str, ours: np.ndarray, ansys: np.ndarray) -> None:
    """Write figures down: ours, those of Ansys, and the difference in per cent."""
    difference = 100.0 * (ours / ansys - 1.0)
    LOG.info("%s\n  ours  %s\n  ansys %s\n  %%     %s", what, ours, ansys, difference.round(2))


@pytest.mark.slow
def test_id16_roughly_and_quickly():
    # Order 2 on this mesh is 13 % too stiff in bending and 30 % in torsion, but 3 % axially. At any
    # order a rigid interface is stiffer in every motion.
    part, top, bottom = joint("flexor_ID16.STEP")
    mesh = part.mesh(PartMesh(order=2, grading=0.7))
    free = Continuum(mesh, STRUCTURAL, order=2, shift=(HERTZ * 60.0) ** 2)
    mean = interface_stiffness(free, top, bottom, rigid=False)
    held = Continuum(mesh, STRUCTURAL, order=2, fixed=f"{top}|{bottom}")
    rigid = interface_stiffness(held, top, bottom)
    assert scipy.linalg.eigh(rigid, mean, eigvals_only=True).min() > 1.0 - 1e-6
    K, _, _ = superelement("flexor_ID16")
    report("flexor_ID16, order 2", np.diag(mean), np.diag(K[:6, :6]))
    assert mean[2, 2] == pytest.approx(K[2, 2], rel=0.04)
    assert (np.diag(mean)[[3, 4, 5]] > np.diag(K)[[3, 4, 5]]).all()


@pytest.mark.evidence
def test_flexor_025():
    """The joint whose geometry is exact, with mean interfaces on the middle of its ends."""
    K, M, _ = superelement("flexor_025")
    ansys = np.diag(K[6:12, 6:12])
    part, top, bottom = joint("flexor_025.step")
    mesh = part.mesh(PartMesh(order=3, thin=0.8))
    free = Continuum(mesh, STAINLESS, order=3, shift=(HERTZ * 60.0) ** 2)
    mean = np.diag(interface_stiffness(free, top, bottom, rigid=False))
    report("flexor_025, mean interfaces", mean, ansys)
    # From the default mesh (thin=1.5) to this one bending fell by 0.4 to 1.0 %, torsion by 1.5 %,
    # shear by 0.5 to 1.3 %, the axial figure by 0.05 %: what is left is of that size and that sign.
    assert mean[2] == pytest.approx(ansys[2], rel=0.002)
    assert mean[3:5] == pytest.approx(ansys[3:5], rel=0.007)
    assert mean[:2] == pytest.approx(ansys[:2], rel=0.012)
    assert mean[5] == pytest.approx(ansys[5], rel=0.015)
    omega, _ = free.modes(10)
    report("flexor_025, free [Hz]", omega[6:10] / HERTZ, frequencies(K, M)[6:10])
    assert omega[6:8] / HERTZ == pytest.approx(frequencies(K, M)[6:8], rel=0.004)
    # the modes with both interfaces held, which stand in K and M as they are
    both = frequencies(K[12:, 12:], M[12:, 12:])
    omega, _ = interface_modes(free, [top, bottom], 6)
    report("flexor_025, both interfaces held in the mean [Hz]", omega / HERTZ, both)
    assert omega / HERTZ == pytest.approx(both, rel=0.02)
    del free
    held = Continuum(mesh, STAINLESS, order=3, fixed=f"{top}|{bottom}")
    rigid = np.diag(interface_stiffness(held, top, bottom))
    report("flexor_025, rigid interfaces", rigid, ansys)
    omega, _ = held.modes(6)
    report("flexor_025, both interfaces held rigidly [Hz]", omega / HERTZ, both)
    # Rigid interfaces cannot be what was meant: 5 % off axially, 14 % in torsion. Bending, which is
    # all in the necks, does not know the difference.
    assert rigid[2] > 1.05 * ansys[2]
    assert rigid[5] > 1.13 * ansys[5]
    assert rigid[3:5] == pytest.approx(mean[3:5], rel=2e-3)


@pytest.mark.evidence
def test_flexor_id16():
    """The joint whose STEP is not quite what was meshed."""
    K, _, _ = superelement("flexor_ID16")
    ansys = np.diag(K[:6, :6])
    part, _, _ = joint("flexor_ID16.STEP")
    # The holes matter axially alone. Order 4 takes another 1 % off bending and 1.4 % off torsion.
    # Shear, 4 to 13 % off, knows which faces are the interfaces, and those are not told.
    for body, axial in ((part, 0.03), (filled(part), 0.005)):
        ends = [body.boundary(body.select("z", end)) for end in ("max", "min")]
        free = Continuum(
            body.mesh(PartMesh(order=3, thin=0.75)),
            STRUCTURAL,
            order=3,
            shift=(HERTZ * 60.0) ** 2,
        )
        mean = np.diag(interface_stiffness(free, *ends, rigid=False))
        report(f"flexor_ID16, {body.source}", mean, ansys)
        assert mean[2] == pytest.approx(ansys[2], rel=axial)
        assert mean[3:5] == pytest.approx(ansys[3:5], rel=0.04)
        assert mean[5] == pytest.approx(ansys[5], rel=0.06)
        assert mean[:2] == pytest.approx(ansys[:2], rel=0.14)


# ------------------------------------------------------------------ the actuator

_SLOPE = math.tan(math.asin(0.17323206121445))  # of the arms, from the STEP
_CORNER = 6.8630277876587709 + (11.217482253405398 - 7.5) / _SLOPE  # inner face meets y = 7.5
_END, _SIDE = 32.5, 5.0  # where the stack ends: an interface node; half its side: assumed


def actuator(end_height: float) -> Part:
    """Return the actuator with the pocket that its STEP fills, and a stack of 10 x 10 mm in it.

    The pocket is 15 mm high as far as the arms' inner faces reach, and `end_height` at its ends.
    """
    shape = read_step(FOLDER / "APA300ML.STEP").shape
    quarter = [(_CORNER, 7.5), (_END, 0.5 * end_height)]
    corners = quarter + [(x, -y) for x, y in reversed(quarter)]
    corners += [(-x, y) for x, y in reversed(corners)]
    points = [occ.gp_Pnt(x, y, -12.0) for x, y in corners]
    edges = [occ.Segment(p, q) for p, q in zip(points, points[1:] + points[:1], strict=True)]
    pocket = occ.Face(occ.Wire(edges)).Extrude(occ.Vec(0.0, 0.0, 24.0))
    shell = (shape - pocket).UnifySameDomain().solids[0]
    pieces = [shell]
    for a, b in ((-32.5, -12.5), (-12.5, -7.5), (-7.5, 12.5), (12.5, 32.5)):
        pieces.append(occ.Box((a, -_SIDE, -_SIDE), (b, _SIDE, _SIDE)))
    for piece, name in zip(pieces, ("shell", "stack1", "spacer", "stack2", "stack3"), strict=True):
        piece.name = name
    return Part.from_shape(occ.Glue(pieces), source="APA300ML with a stack")


def actuator_figures(end_height: float, order: int) -> dict[str, float]:
    """Return output stiffness, ratio, stiffness of the ends, and modes with one end held."""
    K, M, nodes = superelement("APA300ML")
    pieces, _ = stacks(K)
    area = (2e-3 * _SIDE) ** 2
    part = actuator(end_height)
    volume = {b: s.mass * 1e-9 for b, s in zip(part.bodies, part.shape.solids, strict=True)}
    steel = STAINLESS.density * (volume["shell"] + volume["spacer"])
    mass = rigid_mass(M[:42, :42], nodes)[0, 0]
    density = (mass - steel) / (3.0 * volume["stack1"])

    def bar(stiffness: float, length: float, of: float) -> Material:
        e = stiffness * length / area
        return Material(name="bar", youngs_modulus=e, poissons_ratio=0.3, density=of)

    stack = bar((pieces[0] + pieces[2] + pieces[3]) / 3.0, 20e-3, density)
    spacer = bar(pieces[1], 5e-3, STAINLESS.density)
    of = {b: stack if b.startswith("stack") else spacer for b in part.bodies}
    of["shell"] = STAINLESS
    top, bottom = (part.boundary(part.face_at((3.5e-3, y, 8e-3))) for y in (15.001e-3, -15.001e-3))
    right, left = (part.boundary(part.face_at((x, 1e-3, 0.5e-3))) for x in (32.5e-3, -32.5e-3))
    body = Bodies(part.mesh(PartMesh(order=3)), of, order=order, shift=(HERTZ * 60.0) ** 2)
    output = interface_stiffness(body, top, bottom, at=(0.0, 15.001e-3, 0.0), rigid=False)
    # statics of the ends: the bottom is held by no more than what is needed, so it may as well hang
    apart = interface_motion(body, right, (0, 0, 0))[0] - interface_motion(body, left, (0, 0, 0))[0]
    u = body.solve(apart)
    u = body.solve(apart + body.shift * body.mass_times(u))
    lift = (interface_motion(body, top, (0, 0, 0)) - interface_motion(body, bottom, (0, 0, 0)))[1]
    omega, _ = interface_modes(body, [bottom], 3)
    return {
        "output": 1.0 / np.linalg.inv(output)[1, 1],
        "ratio": abs(lift @ u) / (apart @ u),
        "ends": 1.0 / (apart @ u),
        **{f"mode {k}": w / HERTZ for k, w in enumerate(omega, 1)},
    }


def _values(figures: dict[str, float]) -> np.ndarray:
    return np.array(list(figures.values()))


@pytest.mark.evidence
def test_apa300ml_lies_between_two_pockets():
    """The STEP fills the pocket of the shell; two ways to cut it bound what Ansys found."""
    K, M, _ = superelement("APA300ML")
    u = pushed_apart(K, 6, 2)
    modes = frequencies(K[6:, 6:], M[6:, 6:])[:3]
    ansys = {
        "output": 1.0 / np.linalg.inv(K[6:, 6:])[2, 2],
        "ratio": -u[8] / (u[36] - u[12]),
        "ends": 1.0 / (u[36] - u[12]),
        **{f"mode {k}": f for k, f in enumerate(modes, 1)},
    }
    # straight: the arms thin to 0.6 mm at the stack's ends; sloped: they keep their 1.4 mm
    straight = actuator_figures(15.0, 3)
    sloped = actuator_figures(15.0 - 2.0 * (_END - _CORNER) * _SLOPE, 3)
    for what, ours in (("straight", straight), ("sloped", sloped)):
        report(f"APA300ML, {what} pocket: {list(ansys)}", *map(_values, (ours, ansys)))
    for name in ("output", "mode 1", "mode 2", "mode 3"):
        assert straight[name] < ansys[name] < sloped[name]
    assert sloped["ratio"] == pytest.approx(ansys["ratio"], rel=0.02)
    assert straight["ratio"] == pytest.approx(ansys["ratio"], rel=0.13)
    assert straight["ends"] == pytest.approx(ansys["ends"], rel=0.03)
    assert sloped["output"] == pytest.approx(ansys["output"], rel=0.16)
    assert straight["output"] == pytest.approx(ansys["output"], rel=0.16)
    # two thirds of the error of a frequency would be that of the arms' bending stiffness
    for k, tolerance in ((1, 0.08), (2, 0.10), (3, 0.14)):
        assert sloped[f"mode {k}"] == pytest.approx(ansys[f"mode {k}"], rel=tolerance)
        assert straight[f"mode {k}"] == pytest.approx(ansys[f"mode {k}"], rel=tolerance)


@pytest.mark.slow
def test_apa300ml_from_the_command_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The assembly as a STEP file, order 2: ratio and stiffness at the ends of the stack."""
    K, M, nodes = superelement("APA300ML")
    pieces, _ = stacks(K)
    path = tmp_path / "actuator.step"
    actuator(15.0 - 2.0 * (_END - _CORNER) * _SLOPE).shape.WriteStep(str(path))
    part = read_step(path, solid="all")
    volume = {b: s.mass * 1e-9 for b, s in zip(part.bodies, part.shape.solids, strict=True)}
    mass = rigid_mass(M[:42, :42], nodes)[0, 0]
    steel = STAINLESS.density * (volume["shell"] + volume["spacer"])
    density = (mass - steel) / (3.0 * volume["stack1"])
    area = (2e-3 * _SIDE) ** 2
    stack = f"E={sum(pieces[k] for k in (0, 2, 3)) / 3.0 * 20e-3 / area}, nu=0.3, rho={density}"
    top, bottom = (part.face_at((3.5e-3, y, 8e-3)) for y in (15.001e-3, -15.001e-3))
    right, left = (part.face_at((x, 1e-3, 0.5e-3)) for x in (32.5e-3, -32.5e-3))
    words = ["part", str(path), "--hold", bottom, "--ratio", f"{right}:{left}:{top}", "--json"]
    words += ["--material", "E=193 GPa, nu=0.31, rho=7750"]
    words += ["--material", f"spacer=E={pieces[1] * 5e-3 / area}, nu=0.3, rho=7750"]
    words += [w for k in (1, 2, 3) for w in ("--material", f"stack{k}={stack}")]
    with pytest.raises(SystemExit) as end:
        main([*words, "--order", "2", "--modes", "0", "--interfaces", "mean"])
    assert not end.value.code
    found = json.loads(capsys.readouterr().out)
    assert found["mass"] == pytest.approx(mass, rel=1e-3)
    ratio = found["interfaces"]["mean"]["ratio"]
    u = pushed_apart(K, 6, 2)
    # y of the STEP file is z of the super-element
    assert abs(ratio["motion"][1]) == pytest.approx(-u[8] / (u[36] - u[12]), rel=0.01)
    # the sloped pocket leaves more of the shell than there is
    assert 1.0 < ratio["stiffness"] * (u[36] - u[12]) < 1.08
