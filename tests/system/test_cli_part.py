"""The command for parts from STEP files, on a bar whose figures are known by hand.

Evidence (Finite elements): STEP bar ($EA/L$) $10^{-6}$, contraction $10^{-4}$, bending (Timoshenko)
0.2 %; two materials (springs) 1 %
"""

import json
import math
from pathlib import Path

import numpy as np
import pytest
from netgen.occ import Box, Compound

from flexstage.cli import main
from flexstage.quantities.material import material

LENGTH, WIDTH, HEIGHT = 30.0, 4.0, 3.0  # [mm]


def run(*words: str) -> int:
    with pytest.raises(SystemExit) as end:
        main(words)
    return int(end.value.code or 0)


@pytest.fixture
def bar(tmp_path: Path) -> str:
    path = tmp_path / "bar.step"
    Box((0, 0, 0), (LENGTH, WIDTH, HEIGHT)).WriteStep(str(path))
    return str(path)


def test_faces_and_mass(bar: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("part", bar, "--order", "0", "--json") == 0
    found = json.loads(capsys.readouterr().out)
    assert found["mass"] == pytest.approx(2810.0 * LENGTH * WIDTH * HEIGHT * 1e-9, rel=1e-9)
    assert found["volume"] == pytest.approx(LENGTH * WIDTH * HEIGHT * 1e-9, rel=1e-9)
    assert [s["volume"] for s in found["solids"]] == pytest.approx([found["volume"]])
    assert len(found["faces"]) == 6
    assert sum(f["area"] for f in found["faces"]) == pytest.approx(
        2e-6 * (LENGTH * WIDTH + LENGTH * HEIGHT + WIDTH * HEIGHT), rel=1e-9
    )


@pytest.mark.usefixtures("meshed_here")
def test_stiffness_and_modes_of_a_held_bar(bar: str, capsys: pytest.CaptureFixture[str]) -> None:
    words = ("--hold", "x-min", "--move", "x-max", "--size", "6", "--json")
    assert run("part", bar, *words) == 0
    found = json.loads(capsys.readouterr().out)["interfaces"]["rigid"]
    what = material("Al 7075-T6")
    e, length = what.youngs_modulus, LENGTH * 1e-3
    area = WIDTH * HEIGHT * 1e-6
    # rigid ends hold the bar from contracting there: a little stiffer than E A/L
    assert found["stiffness"][0][0] == pytest.approx(e * area / length, rel=0.03)
    thin = e * WIDTH * HEIGHT**3 / 12.0 * 1e-12
    # clamped and guided, sheared as well: 12 E I/L^3 less 3 % for L/h = 10
    assert found["stiffness"][2][2] == pytest.approx(12.0 * thin / length**3, rel=0.05)
    first = 1.8751**2 / (2.0 * math.pi) * math.sqrt(thin / (what.density * area * length**4))
    assert found["natural_frequency_hz"][0] == pytest.approx(first, rel=0.02)


@pytest.mark.usefixtures("meshed_here")
def test_a_free_part_has_no_modes_at_nothing(bar: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("part", bar, "--size", "6", "--modes", "2") == 0
    assert "natural frequencies in Hz, free" in " ".join(capsys.readouterr().out.split())
    assert run("part", bar, "--size", "6", "--modes", "2", "--json") == 0
    shown = json.loads(capsys.readouterr().out)["interfaces"]["free"]["natural_frequency_hz"]
    what = material("Al 7075-T6")
    thin = what.youngs_modulus * WIDTH * HEIGHT**3 / 12.0 * 1e-12
    mass = what.density * WIDTH * HEIGHT * 1e-6
    first = 4.7300**2 / (2.0 * math.pi) * math.sqrt(thin / (mass * (LENGTH * 1e-3) ** 4))
    # shear and rotary inertia take 3 % at L/h = 10
    assert len(shown) == 2
    assert 0.95 * first < shown[0] < first


@pytest.mark.usefixtures("meshed_here")
@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--hold", "top"], "has no face 'top'"),
        (["--move", "x-max"], "name faces to hold"),
        (["--hold", "x-max", "--move", "x-max"], "cannot be fixed and moved"),
        (["--material", "unobtainium"], "unobtainium"),
        (["--size", "-1"], "'--size': must be above 0"),
        (["--interfaces", "soft"], "must be rigid, mean or both, got 'soft'"),
        (["--hold", "x-min", "--ratio", "x-max:y-min"], "between three faces, END:END:OUTPUT"),
        (["--hold", "x-min", "--ratio", "x-max:y-min:x-max"], "got one of them twice"),
        (["--ratio", "x-max:x-min:y-max"], "name faces to hold"),
        (["--hold", "x-min", "--move", "x-max", "--at", "1,2"], "three lengths X,Y,Z"),
        (["--material", "E=70 GPa, nu=0.3"], "lacks rho"),
        (["--material", "E=70 GPa, nu=0.3, rho=2 g"], "rho of the material"),
        (["--material", "E=70 GPa, nu=0.7, rho=2700"], "poissons_ratio must lie between"),
        (["--material", "E=70 GPa, nu=steel, rho=2700"], "a plain number, got 'steel'"),
        (["--material", "E=70 GPa, nu=0.3, mass=3 g"], "each of the three once, got 'mass=3 g'"),
        (["--material", "2=Invar 36"], "no solid '2' for the material: it has 1 body1"),
        (["--material", "Invar 36", "--material", "Ti-6Al-4V"], "both for all solids"),
        (["--solids", "2"], "has the solids 1 body1; got '2'"),
        (["--figure", "picture.txt"], "'--figure': the name must end in"),
    ],
)
def test_bad_input(
    bar: str, capsys: pytest.CaptureFixture[str], words: list[str], said: str
) -> None:
    assert run("part", bar, *words) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.count("\n") == 1
    assert said in captured.err


@pytest.mark.usefixtures("meshed_here")
def test_a_file_without_a_solid(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "face.step"
    Box((0, 0, 0), (1, 1, 1)).faces[0].WriteStep(str(path))
    assert run("part", str(path)) == 2
    assert "solid" in capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.usefixtures("meshed_here")
def test_own_material_and_both_kinds_of_interfaces(
    bar: str, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ("--hold", "x-min", "--move", "x-max", "--size", "6", "--modes", "1", "--json")
    own = "E=115 GPa, nu=0.34, rho=8.8 g/cm^3"
    assert run("part", bar, "--material", own, *words) == 0
    captured = capsys.readouterr()
    found = json.loads(captured.out)
    assert found["mass"] == pytest.approx(8800.0 * LENGTH * WIDTH * HEIGHT * 1e-9, rel=1e-9)
    rigid, mean = found["interfaces"]["rigid"], found["interfaces"]["mean"]
    axial = 115e9 * WIDTH * HEIGHT / LENGTH * 1e-3
    # uniform tension is an exact solution between mean interfaces; rigid ones hold the bar's width
    assert mean["stiffness"][0][0] == pytest.approx(axial, rel=1e-6)
    assert 1.005 * axial < rigid["stiffness"][0][0] < 1.03 * axial
    assert mean["natural_frequency_hz"][0] < rigid["natural_frequency_hz"][0]
    assert "expected: about" in captured.err
    ratio = found["expected"]["unknowns"] / found["unknowns"]
    assert 0.3 < ratio < 3.0  # some dozen elements


@pytest.mark.slow
@pytest.mark.usefixtures("meshed_here")
def test_the_point_of_the_stiffness(bar: str, capsys: pytest.CaptureFixture[str]) -> None:
    words = ("--hold", "x-min", "--move", "x-max", "--size", "8", "--order", "2", "--modes", "0")
    found = []
    for at in ((), ("--at", "0,2,1.5")):
        assert run("part", bar, *words, *at, "--interfaces", "mean", "--json") == 0
        found.append(json.loads(capsys.readouterr().out)["interfaces"]["mean"]["stiffness"])
    end, foot = (np.array(k) for k in found)
    shift = np.eye(6)
    # a rotation about the foot moves the end by omega x r
    shift[1, 5], shift[2, 4] = LENGTH * 1e-3, -LENGTH * 1e-3
    assert foot == pytest.approx(shift.T @ end @ shift, rel=1e-6, abs=1e-6 * abs(end).max())


@pytest.mark.usefixtures("meshed_here")
def test_ratio_of_three_faces(bar: str, capsys: pytest.CaptureFixture[str]) -> None:
    words = ("--hold", "y-min", "--ratio", "x-max:x-min:y-max", "--modes", "0", "--size", "6")
    own = ("--material", "E=115 GPa, nu=0.34, rho=8800")
    assert run("part", bar, *own, *words, "--interfaces", "mean", "--json") == 0
    found = json.loads(capsys.readouterr().out)["interfaces"]["mean"]["ratio"]
    # a bar that is drawn longer grows narrower: nu b/L
    assert found["direction"] == pytest.approx([1.0, 0.0, 0.0], abs=1e-9)
    assert found["motion"][1] == pytest.approx(-0.34 * WIDTH / LENGTH, rel=1e-4)
    assert found["ratio"] == pytest.approx(0.34 * WIDTH / LENGTH, rel=1e-4)
    assert found["stiffness"] == pytest.approx(115e9 * WIDTH * HEIGHT / LENGTH * 1e-3, rel=1e-6)
    assert run("part", bar, *words, "--interfaces", "rigid") == 2
    assert "touch each other" in capsys.readouterr().err


@pytest.fixture
def chain(tmp_path: Path) -> str:
    """Two bars end to end, of one section, and a third that touches neither."""
    first = Box((0, 0, 0), (20.0, WIDTH, HEIGHT))
    second = Box((20.0, 0, 0), (32.0, WIDTH, HEIGHT))
    third = Box((40.0, 0, 0), (45.0, WIDTH, HEIGHT))
    first.name, second.name = "shell", "stack"
    path = tmp_path / "chain.step"
    Compound([first, second, third]).WriteStep(str(path))
    return str(path)


@pytest.mark.usefixtures("meshed_here")
def test_an_assembly_of_two_materials(chain: str, capsys: pytest.CaptureFixture[str]) -> None:
    soft, hard = "E=46 GPa, nu=0.3, rho=7600", "E=193 GPa, nu=0.3, rho=7750"
    which = ("--solids", "shell,2", "--material", hard, "--material", f"stack={soft}")
    words = ("--hold", "x-min", "--move", "x-max", "--size", "6", "--modes", "0", "--json")
    assert run("part", chain, *which, *words) == 0
    found = json.loads(capsys.readouterr().out)
    area = WIDTH * HEIGHT
    assert found["mass"] == pytest.approx((7750 * 20 + 7600 * 12) * area * 1e-9, rel=1e-9)
    joints = [f for f in found["faces"] if len(f["solids"]) == 2]
    assert [j["solids"] for j in joints] == [["shell", "stack"]]
    assert len(found["faces"]) == 11
    series = 1e-3 * area / (20.0 / 193e9 + 12.0 / 46e9)
    # the stiff one holds the width of the soft one at the joint: some tenths of a per cent
    mean = found["interfaces"]["mean"]["stiffness"][0][0]
    assert series < mean < 1.01 * series
    assert run("part", chain, *which, "--order", "0") == 0
    shown = " ".join(capsys.readouterr().out.split())
    assert "bonded joints: shell and stack at " in shown


@pytest.mark.usefixtures("meshed_here")
@pytest.mark.parametrize(
    ("words", "said"),
    [
        ((), "'body3' of "),
        (("--material", "stack=Invar 36"), "solid 'shell' has no material"),
        (("--material", "1=Invar 36", "--material", "shell=Invar 36"), "two materials"),
        (("--solids", "shell,ram"), "got 'ram': give a name, a number or 'all'"),
    ],
)
def test_bad_assemblies(
    chain: str, capsys: pytest.CaptureFixture[str], words: tuple[str, ...], said: str
) -> None:
    assert run("part", chain, *words, "--hold", "x-min") == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.count("\n") == 1
    assert said in captured.err


@pytest.mark.usefixtures("meshed_here")
def test_solids_that_overlap(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "overlap.step"
    Compound([Box((0, 0, 0), (5, 4, 3)), Box((4.9, 1, 0), (9, 3, 2))]).WriteStep(str(path))
    assert run("part", str(path), "--order", "0") == 2
    assert "overlap, body1, body2: joined they fall into 3 pieces" in capsys.readouterr().err


@pytest.mark.usefixtures("meshed_here")
def test_a_mesh_that_will_not_fit_is_refused_before_it_is_made(
    bar: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def never(*_: object) -> None:
        raise AssertionError("it must not be meshed")

    monkeypatch.setattr("flexstage.fem.part_estimate.memory_available", lambda: 1e9)
    monkeypatch.setattr("flexstage.fem.part.mesh_shape", never)
    assert run("part", bar, "--size", "0.05", "--hold", "x-min") == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert "will need about" in captured.err
    assert "1 GB are free: with elements of 0.05 mm of order 3" in captured.err
    size = float(captured.err.split("elements of ")[-1].split(" mm would fit")[0])
    assert 0.3 < size < 1.5
    monkeypatch.setattr("flexstage.fem.part_estimate.memory_available", lambda: 1e3)
    assert run("part", bar, "--size", "6", "--hold", "x-min") == 2
    assert "no element size is large enough" in capsys.readouterr().err
    monkeypatch.undo()
    monkeypatch.setattr("flexstage.elasticity.resources.memory_available", lambda: 1e3)
    monkeypatch.setattr("flexstage.fem.part_estimate.memory_available", lambda: 1e3)
    words = ("--hold", "y-min", "--ratio", "x-max:x-min:y-max", "--interfaces", "mean", "--force")
    assert run("part", bar, *words, "--size", "6", "--order", "2", "--modes", "0") == 0
    shown = " ".join(capsys.readouterr().out.split())
    assert "motion of the output per metre of relative motion of the ends along (1, 0, 0)" in shown


def test_words_of_the_geometry_kernel_stay_off_standard_output(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "part.step"
    path.write_text("ISO-10303-21;\nHEADER;\nnonsense\nEND-ISO-10303-21;\n")
    assert run("part", str(path), "--json") == 2
    captured = capfd.readouterr()
    assert json.loads(captured.out)["error"]["message"] in captured.err
    assert captured.err.count("\n") == 1


@pytest.mark.usefixtures("meshed_here")
def test_a_picture_with_the_names_of_faces(
    bar: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "part.svg"
    assert run("part", bar, "--order", "0", "--hold", "x-min", "--figure", str(path)) == 0
    assert f"picture: {path}" in capsys.readouterr().out.replace("\n", "")
    text = path.read_text()
    assert all(f">{name}<" in text for name in (f"face{k}" for k in range(1, 7)))
    assert "fixed, blue: face" in text
