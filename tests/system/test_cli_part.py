"""The command for parts from STEP files, on a bar whose figures are known by hand."""

import json
import math
from pathlib import Path

import pytest
from netgen.occ import Box

from flexstage.cli import main
from flexstage.material import material

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
    assert len(found["faces"]) == 6
    assert sum(f["area"] for f in found["faces"]) == pytest.approx(
        2e-6 * (LENGTH * WIDTH + LENGTH * HEIGHT + WIDTH * HEIGHT), rel=1e-9
    )


def test_stiffness_and_modes_of_a_held_bar(bar: str, capsys: pytest.CaptureFixture[str]) -> None:
    words = ("--hold", "x-min", "--move", "x-max", "--size", "6", "--json")
    assert run("part", bar, *words) == 0
    found = json.loads(capsys.readouterr().out)
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


def test_a_free_part_has_no_modes_at_nothing(bar: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("part", bar, "--size", "6", "--modes", "2") == 0
    assert "natural frequencies in Hz, free" in " ".join(capsys.readouterr().out.split())
    assert run("part", bar, "--size", "6", "--modes", "2", "--json") == 0
    shown = json.loads(capsys.readouterr().out)["natural_frequency_hz"]
    what = material("Al 7075-T6")
    thin = what.youngs_modulus * WIDTH * HEIGHT**3 / 12.0 * 1e-12
    mass = what.density * WIDTH * HEIGHT * 1e-6
    first = 4.7300**2 / (2.0 * math.pi) * math.sqrt(thin / (mass * (LENGTH * 1e-3) ** 4))
    # shear and rotary inertia take 3 % at L/h = 10
    assert len(shown) == 2
    assert 0.95 * first < shown[0] < first


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--hold", "top"], "has no face 'top'"),
        (["--move", "x-max"], "name some to hold"),
        (["--hold", "x-max", "--move", "x-max"], "cannot be held and moved"),
        (["--material", "unobtainium"], "unobtainium"),
        (["--size", "-1"], "mesh size must be positive"),
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


def test_a_file_without_a_solid(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "face.step"
    Box((0, 0, 0), (1, 1, 1)).faces[0].WriteStep(str(path))
    assert run("part", str(path)) == 2
    assert "solid" in capsys.readouterr().err
