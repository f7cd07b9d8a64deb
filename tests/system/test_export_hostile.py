"""`flexstage export` under names, numbers and places that nobody should choose."""

import csv
import io
import json
import re
import subprocess
import zipfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import ezdxf
import pytest
import yaml
from fmpy.validation import validate_fmu

from flexstage.base.errors import ModelError
from flexstage.cli import main
from flexstage.export.diagram.svg import diagram_files
from flexstage.export.fmu.fmu_file import fmu_files
from flexstage.export.fmu.layout import plain_names
from flexstage.export.matlab import matlab_files
from flexstage.export.step import step_files
from flexstage.files.names import file_name, file_names
from flexstage.files.write import write_files
from flexstage.hysteresis import dynamic_model
from flexstage.lumped import lumped_system
from flexstage.stage import Stage, read_stage
from tests.c_compiler import compile_program
from tests.octave_program import OCTAVE, run_octave

_EXAMPLE = Path(__file__).parents[1] / "spelled_out_parallelogram.yaml"
_HOSTILE = "*/ #\"'<&>%s \\ äΩ微🔧"


def _text(
    *,
    name: str = "plain",
    title: str = "",
    hinge: str = "left foot",
    drives: Sequence[str] = ("stack",),
    probes: Sequence[str] = ("gauge",),
    axes: Sequence[str] = ("x",),
    drop: Sequence[str] = (),
) -> str:
    """The example with other names; a drive, a probe and an axis for each that is given."""
    made: dict[str, Any] = yaml.safe_load(_EXAMPLE.read_text(encoding="utf-8"))
    made |= {"name": name, "title": title}
    made["hinges"][hinge] = made["hinges"].pop("left foot")
    stack, gauge = made["drives"]["stack"], made["probes"]["gauge"]
    made["drives"] = {
        d: stack | {"at": [[26, 48 + 5 * i], [20, 48 + 5 * i]]} for i, d in enumerate(drives)
    }
    made["probes"] = {p: gauge | {"at": [81, 48 + 5 * i]} for i, p in enumerate(probes)}
    made["axes"] = {
        a: {"drive": d, "probe": p} for a, d, p in zip(axes, drives, probes, strict=True)
    }
    for path in drop:
        *above, key = path.split("/")
        inside = made
        for part in above:
            inside = inside[part]
        del inside[key]
    # what is JSON is YAML too
    return json.dumps(made, ensure_ascii=False)


def _stage(folder: Path, **names: Any) -> Stage:
    path = folder / "stage.yaml"
    path.write_text(_text(**names), encoding="utf-8")
    return read_stage(path)


def _run(folder: Path, *words: str, **names: Any) -> int:
    path = folder / "stage.yaml"
    path.write_text(_text(**names), encoding="utf-8")
    with pytest.raises(SystemExit) as ended:
        main(["export", str(path), "--model", "lumped", *words])
    return int(ended.value.code or 0)


# ------------------------------------------------------------------ names of files


@pytest.mark.parametrize("name", ["-o", "--", "...", "a/b", "CON", "aux", "nul.x", "x" * 80])
def test_a_file_can_be_called_so_on_every_system(name: str) -> None:
    made = file_name(name)
    assert re.fullmatch(r"[A-Za-z0-9_][-A-Za-z0-9_.]*", made)
    assert made.partition(".")[0].lower() not in {"con", "aux", "nul"}


@pytest.mark.parametrize("name", ["-o", "...", "a/b: c", "𝐀" * 80, "微" * 80, "é" * 80])
def test_names_of_files_are_cut_to_what_systems_take(name: str) -> None:
    # the longest ending of ours, and those of a file that is being written, need 60 bytes
    assert len(file_name(name).encode()) <= 255 - 60


def test_no_two_files_are_called_alike() -> None:
    made = file_names(["q 1", "q.1", "q-1", "Q/1", "q-1-2"])
    assert len({m.lower() for m in made}) == 5


def test_axes_that_fall_together_have_a_diagram_each(tmp_path: Path) -> None:
    stage = _stage(tmp_path, drives=("a", "b"), probes=("a", "b"), axes=("q 1", "Q-1"))
    assert len(diagram_files(stage)) == 2


def test_the_longest_names_are_written(tmp_path: Path) -> None:
    longest = "𝐀" * 80
    words = ["--to", "diagram,step,drawing,vtu,uff,csv,dxf", "--folder", str(tmp_path / "out")]
    names = {"drives": (longest,), "probes": (longest,), "axes": (longest,)}
    assert _run(tmp_path, *words, name=longest, hinge=longest, **names) == 0


# ------------------------------------------------------------------ names in files


def test_names_in_step_are_those_of_the_stage(tmp_path: Path) -> None:
    # longer than the lines of the kernel, which breaks them within letters of several bytes
    hinge = "微動🔧'\\" * 13
    (content,) = step_files(_stage(tmp_path, hinge=hinge, name="äß\\'")).values()
    text = content.decode("ascii")

    def plain(found: re.Match[str]) -> str:
        return bytes.fromhex(found[1]).decode("utf-16-be")

    read = re.sub(r"\\X2\\([0-9A-F]+)\\X0\\", plain, text)
    doubled = hinge.replace("\\", "\\\\").replace("'", "''")
    assert read.count(f"'{doubled} neck left'") == 1
    assert read.count(f"'{doubled} neck right'") == 1
    assert read.count("'left head neck left'") == 1
    assert "'äß\\\\'''" in read
    assert not re.search(r"flexstage\d+name", read)


def test_variables_of_an_fmu_differ_whatever_drives_are_called(tmp_path: Path) -> None:
    names = {"drives": ("ä.1", "微"), "probes": ("..", "é"), "axes": ("x", "y")}
    stage = _stage(tmp_path, name=_HOSTILE, title=_HOSTILE, **names)
    model = dynamic_model(stage, lumped_system(stage), bandwidth=2e3)
    for version in ("2.0", "3.0"):
        (content,) = fmu_files(model, version=version, binary=False).values()  # type: ignore[arg-type]
        path = tmp_path / "stage.fmu"
        path.write_bytes(content)
        # names that are alike, or that its convention does not have, would be among these
        assert validate_fmu(str(path)) == []
        with zipfile.ZipFile(path) as archive:
            said = archive.read("modelDescription.xml").decode("utf-8")
        assert "command of drive ä.1 (piezo)" in said


def test_names_of_drives_in_an_fmu_are_of_one_part() -> None:
    found = plain_names("drive", ["ä", "ö", "a", "x.1", "x_1", "", ".", "sensor", "微", "軸", "1"])
    assert len(set(found)) == 11
    assert found[-1] == "drive_1"
    assert not any("." in name or not name.isascii() or name == "sensor" for name in found)
    assert found[0] == "a"


@pytest.mark.parametrize(
    ("name", "file"),
    [("end", "stage_end"), ("sin", "stage_sin"), ("Load", "stage_Load"), ("x-y", "x_y")],
)
def test_a_script_hides_nothing_that_it_calls(name: str, file: str, tmp_path: Path) -> None:
    stage = _stage(tmp_path, name=name)
    files = matlab_files(stage, dynamic_model(stage, lumped_system(stage)))
    assert set(files) == {f"{file}.mat", f"{file}.m", f"{file}_step.m"}


@pytest.mark.skipif(OCTAVE is None, reason="GNU Octave is not installed")
def test_octave_runs_the_script_of_a_stage_called_sin(tmp_path: Path) -> None:
    stage = _stage(tmp_path, name="sin", title=_HOSTILE, drives=(_HOSTILE,))
    files = matlab_files(stage, dynamic_model(stage, lumped_system(stage)))
    write_files(tmp_path, files)
    code = "warning('off'); stage_sin; printf('%d modes\\n', numel(S.omega));"
    done = run_octave(tmp_path, code)
    assert done.returncode == 0, done.stderr
    assert "9 modes" in done.stdout


def test_every_format_bears_every_letter(tmp_path: Path) -> None:
    out = tmp_path / "out"
    names = {"drives": (_HOSTILE,), "probes": (_HOSTILE,), "axes": (_HOSTILE,)}
    words = ["--to", "all", "--source-only", "--folder", str(out), "--kerf", "0.3 mm"]
    words += ["--bandwidth", "2 kHz"]
    title = f"{_HOSTILE}\n#error\n=1+1"
    assert _run(tmp_path, *words, name=_HOSTILE, title=title, hinge=_HOSTILE, **names) == 0
    for path in (*out.rglob("*.svg"), *out.rglob("*.pvd")):
        ET.parse(path)
    for path in out.rglob("*.csv"):
        rows = list(csv.reader(io.StringIO(path.read_text(encoding="utf-8-sig"), newline="")))
        assert len({len(row) for row in rows}) == 1, path.name
    for path in out.rglob("*.uff"):
        assert max(map(len, path.read_bytes().split(b"\n"))) <= 80
    (drawing,) = out.rglob("*.dxf")
    audit = ezdxf.readfile(drawing).audit()  # type: ignore[attr-defined]
    assert not audit.errors
    assert not audit.fixes
    (example,) = (out / "c").glob("*_example.c")
    header = example.with_name(example.name.replace("_example.c", ".h"))
    files = {header.name: header.read_bytes()}
    program = compile_program(tmp_path, example.read_text(encoding="utf-8"), files=files)
    lines = subprocess.run([program], capture_output=True, text=True, check=True).stdout
    assert len({len(row) for row in csv.reader(lines.splitlines())}) == 1


# ------------------------------------------------------------------ numbers and places


@pytest.mark.parametrize("step", ["1e300 s", "1e-300 s"])
def test_a_step_beyond_all_use_is_refused(step: str, tmp_path: Path, capsys) -> None:
    out = tmp_path / "out"
    assert _run(tmp_path, "--to", "c", "--time-step", step, "--folder", str(out)) == 2
    assert "'--time-step': must be from 1e-12 to 1e+06 s" in capsys.readouterr().err
    assert not out.exists()


def test_a_start_hole_is_as_wide_as_a_wide_cut(tmp_path: Path) -> None:
    assert _run(tmp_path, "--to", "dxf", "--kerf", "1.4 mm", "--folder", str(tmp_path)) == 0
    space = ezdxf.readfile(tmp_path / "plain.dxf").modelspace()  # type: ignore[attr-defined]
    holes = [e for e in space if e.dxf.layer == "START_HOLES" and e.dxftype() == "CIRCLE"]
    assert {round(e.dxf.radius, 9) for e in holes} == {0.7}


@pytest.mark.parametrize(
    ("to", "drop", "said"),
    [
        ("mat", ("axes", "probes"), "stage 'plain' has no probe: there is nothing to read"),
        ("mat", ("axes", "drives"), "stage 'plain' has no drive: another program could not"),
        ("csv", ("axes",), "stage 'plain' has no axis and so no characteristics"),
        ("step,csv", ("axes", "drives"), "stage 'plain' has no axis"),
    ],
)
def test_what_a_stage_lacks_is_said(to: str, drop, said: str, tmp_path: Path, capsys) -> None:
    out = tmp_path / "out"
    assert _run(tmp_path, "--to", to, "--folder", str(out), drop=drop) == 2
    assert said in capsys.readouterr().err
    assert not out.exists()


def test_stacks_without_a_range_can_be_taken_as_linear(tmp_path: Path) -> None:
    stage = _stage(tmp_path, drop=("drives/stack/voltage_range",))
    with pytest.raises(ModelError, match=r"or export without hysteresis \(--hysteresis none\)"):
        dynamic_model(stage, lumped_system(stage))
    assert dynamic_model(stage, lumped_system(stage), hysteresis="none").drives[0].gain > 0.0


def test_of_several_formats_all_are_written_or_none(tmp_path: Path, capsys) -> None:
    out = tmp_path / "a" / "b"
    (out / "csv" / "plain-values.csv").mkdir(parents=True)
    assert _run(tmp_path, "--to", "step,csv", "--folder", str(out)) == 1
    assert "is a directory" in capsys.readouterr().err
    assert [p.name for p in out.rglob("*")] == ["csv", "plain-values.csv"]


def test_folders_that_were_made_for_nothing_go_again(tmp_path: Path) -> None:
    with pytest.raises(OSError, match="x" * 20):
        write_files(tmp_path / "a" / "b", {"c/d": b"1", "e/" + "x" * 300: b"2"})
    assert not list(tmp_path.iterdir())


def test_an_fmu_without_a_library_is_said_to_be_one(tmp_path: Path, capsys, monkeypatch) -> None:
    monkeypatch.setattr("flexstage.export.fmu.fmu_file.compiler", lambda: None)
    monkeypatch.setattr("flexstage.export.fmu.fmu_file.compiler", lambda: None)
    out = str(tmp_path / "out")
    words = ["--to", "fmu", "--fmi", "2.0", "--folder", out, "--json"]
    assert _run(tmp_path, *words) == 0
    assert any("No C compiler" in note for note in json.loads(capsys.readouterr().out)["notes"])
    assert _run(tmp_path, *words, "--source-only") == 0
    assert not any("No C compiler" in n for n in json.loads(capsys.readouterr().out)["notes"])


def test_a_table_of_very_many_files_is_short(tmp_path: Path, capsys) -> None:
    assert _run(tmp_path, "--to", "vtu", "--folder", str(tmp_path / "out")) == 0
    shown = capsys.readouterr().out
    assert re.search(r"and \d+ more +\n", shown)
    assert len(shown.splitlines()) < 30
