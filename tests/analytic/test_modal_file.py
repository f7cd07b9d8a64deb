"""Universal files of modes and responses: read back by pyuff and by the reader of records.

Evidence (Exported files): universal file, read by pyuff (modes, responses): six; 13 digits
"""

import csv
import io
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from flexstage.base.errors import StageError
from flexstage.export.modal_file import (
    direction_code,
    frf_file,
    modal_file,
    modal_points,
    trace_lines,
    universal_files,
)
from flexstage.lumped import lumped_system
from flexstage.records.universal_file import read_universal
from flexstage.stage import Stage, mass_properties
from flexstage.stage.designs import design
from flexstage.system import RayleighDamping, frequency_response, modes
from flexstage.system.response import default_frequencies_hz

pyuff = pytest.importorskip("pyuff")

STAGE = design("vgtu-piezo")
SYSTEM = lumped_system(STAGE, damping=RayleighDamping(alpha=7.0, beta=3e-6))
#: The format has six digits for shapes and uneven frequencies, thirteen for values of functions.
SIX, THIRTEEN = 5.1e-6, 5.1e-13


def read(content: bytes, folder: Path) -> list[dict[str, Any]]:
    path = folder / "file.uff"
    path.write_bytes(content)
    found = pyuff.UFF(str(path)).read_sets()
    return found if isinstance(found, list) else [found]


def of_kind(sets: list[dict[str, Any]], kind: int) -> list[dict[str, Any]]:
    return [s for s in sets if s["type"] == kind]


def shape_of(mode: dict[str, Any]) -> np.ndarray:
    return np.column_stack([mode[f"r{i}"] for i in range(1, 7)])


@pytest.fixture(scope="module")
def files() -> dict[str, bytes]:
    return universal_files(STAGE, SYSTEM, count=14)


def test_modes_are_read_back_with_frequency_damping_and_motion(
    files: dict[str, bytes], tmp_path: Path
) -> None:
    sets = read(files["vgtu-piezo-modes.uff"], tmp_path)
    found = modes(SYSTEM, count=14)
    written = of_kind(sets, 55)
    assert len(written) == 14 == found.omega.size
    for k, mode in enumerate(written):
        assert (mode["mode_n"], mode["modal_m"], mode["n_data_per_node"]) == (k + 1, 1.0, 6)
        assert mode["freq"] == pytest.approx(found.frequency_hz[k], rel=SIX)
        ratio = 0.5 * (7.0 / found.omega[k] + 3e-6 * found.omega[k])
        assert mode["modal_damp_vis"] == pytest.approx(ratio, rel=SIX)
        shape = shape_of(mode)
        for p in SYSTEM.probes:
            point = modal_points(STAGE).numbers["probe", p.name]
            angle = STAGE.probe(p.name).direction
            along = np.array((math.cos(angle), math.sin(angle))) @ shape[point - 1, :2]
            expected = p.vector @ found.shapes[:, k]
            # six digits of each component
            assert along == pytest.approx(expected, abs=2 * SIX * np.abs(shape[:, :2]).max())
    (heading,), (units,) = of_kind(sets, 151), of_kind(sets, 164)
    assert heading["model_name"] == "vgtu-piezo"
    assert "flexstage" in heading["program"]
    assert (units["units_code"], units["length"], units["force"]) == (1, 1.0, 1.0)


def test_points_and_lines_are_those_of_the_stage(files: dict[str, bytes], tmp_path: Path) -> None:
    sets = read(files["vgtu-piezo-modes.uff"], tmp_path)
    (points,) = of_kind(sets, 2411)
    at = np.column_stack([points[c] for c in "xyz"])
    assert points["node_nums"].tolist() == list(range(1, len(at) + 1))
    rows = list(csv.DictReader(io.StringIO(files["vgtu-piezo-points.csv"].decode())))
    listed = np.array([[float(r[f"{c} [m]"]) for c in "xyz"] for r in rows])
    assert at == pytest.approx(listed, rel=1e-15)
    assert [int(r["point"]) for r in rows] == list(range(1, len(rows) + 1))
    centres = {r["body"]: at[i] for i, r in enumerate(rows) if "centre of mass" in r["what"]}
    for name, properties in mass_properties(STAGE).items():
        assert centres[name] == pytest.approx((*properties.centre, 0.0), rel=1e-15)
    # outlines enclose the bodies: their areas, by the formula of the trapezoid, make the mass
    area = dict.fromkeys(centres, 0.0)
    bodies = [r["body"] for r in rows]
    for line in of_kind(sets, 82):
        nodes = line["nodes"].astype(int)
        assert nodes[0] == nodes[-1]
        (body,) = {bodies[n - 1] for n in nodes}
        x, y = at[nodes - 1, :2].T
        size = abs(0.5 * np.sum(x[:-1] * y[1:] - x[1:] * y[:-1]))
        area[body] += size if "outline" in line["id"] else -size
    for name, properties in mass_properties(STAGE).items():
        own = properties.mass - sum(m.mass for m in STAGE.body(name).extra_masses)
        # chords within 50 um of arcs of 1 mm radius, beside bodies of some mm^2
        assert area[name] == pytest.approx(
            own / (STAGE.material.density * STAGE.thickness), rel=0.03
        )


@pytest.mark.parametrize(
    "reader", ["pyuff", "records"], ids=["by pyuff", "by the reader of records"]
)
def test_responses_are_read_back_to_thirteen_digits(
    reader: str, files: dict[str, bytes], tmp_path: Path
) -> None:
    content = files["vgtu-piezo-frf.uff"]
    around = default_frequencies_hz(modes(SYSTEM, count=14))
    frequencies = np.unique([float(f"{f:.5e}") for f in around])
    points = modal_points(STAGE).numbers
    functions = of_kind(read(content, tmp_path), 58)
    assert len(functions) == 4
    for drive in STAGE.drives:
        for probe in STAGE.probes:
            expected = frequency_response(SYSTEM, frequencies, drive.name, probe.name).value
            places = points["probe", probe.name], points["drive", drive.name]
            codes = direction_code(probe.direction), direction_code(drive.direction)
            if reader == "pyuff":
                wanted = (*places, *codes)
                keys = ("rsp_node", "ref_node", "rsp_dir", "ref_dir")
                (f,) = (f for f in functions if tuple(f[k] for k in keys) == wanted)
                assert (f["func_type"], f["orddenom_spec_data_type"]) == (4, 13)
                assert f["x"].tolist() == frequencies.tolist()
                value = f["data"]
            else:
                columns = read_universal(tmp_path / "file.uff")
                letters = {1: "+x", -1: "-x", 2: "+y", -2: "-y"}
                name = "/".join(f"{n}:{letters[c]}" for n, c in zip(places, codes, strict=True))
                by_name = {c.name: c for c in columns.columns}
                assert by_name[f"{name} real"].unit == "m/N"
                assert columns.axis is not None
                assert columns.axis.tolist() == frequencies.tolist()
                value = by_name[f"{name} real"].values + 1j * by_name[f"{name} imaginary"].values
            for part, exact in ((value.real, expected.real), (value.imag, expected.imag)):
                assert np.all(np.abs(part - exact) <= THIRTEEN * np.abs(exact))


@pytest.mark.parametrize("turned", [False, True], ids=["as designed", "probes turned round"])
def test_modes_of_one_file_make_the_responses_of_the_other(turned: bool, tmp_path: Path) -> None:
    """As a modal program sees it: nothing but the two files and what their numbers mean."""
    name = "vgtu-mechanical" if turned else "vgtu-piezo"
    stage = design(name)
    if turned:
        probes = tuple(replace(p, direction=p.direction - math.pi) for p in stage.probes)
        stage = replace(stage, probes=probes)
    system = lumped_system(stage)
    count = system.order
    files = universal_files(stage, system, count=count)
    found = of_kind(read(files[f"{name}-modes.uff"], tmp_path), 55)
    omega = 2.0 * np.pi * np.array([m["freq"] for m in found])
    ratio = np.array([m["modal_damp_vis"] for m in found])
    shapes = np.array([shape_of(m) for m in found])
    rows = list(csv.DictReader(io.StringIO(files[f"{name}-points.csv"].decode())))
    reaction = {
        word.removeprefix("reaction of drive "): i
        for i, r in enumerate(rows)
        for word in r["what"].split("; ")
        if word.startswith("reaction of drive ")
    }
    functions = of_kind(read(files[f"{name}-frf.uff"], tmp_path), 58)
    assert all((f["rsp_dir"] < 0) == turned for f in functions)
    assert len(functions) == len(stage.drives) * len(stage.probes)
    for f in functions:

        def along(point: int, code: int) -> np.ndarray:
            return np.sign(code) * shapes[:, point, abs(code) - 1]

        probe = along(f["rsp_node"] - 1, f["rsp_dir"])
        # the drive also pushes back, on the body that the table names
        drive = along(f["ref_node"] - 1, f["ref_dir"])
        drive = drive - along(reaction[f["ref_ent_name"]], f["ref_dir"])
        w = 2.0 * np.pi * f["x"][:, None]
        value = np.sum(probe * drive / (omega**2 - w**2 + 2j * ratio * omega * w), axis=1)
        # six digits of each shape and frequency; a resonance is 50 times as sharp as its frequency
        largest = np.abs(f["data"]).max()
        cross = f["rsp_dir"] != f["ref_dir"]
        scale = max(np.abs(g["data"]).max() for g in functions) if cross else largest
        assert np.abs(value - f["data"]).max() < 100 * SIX * scale


def test_free_displacement_of_a_drive_is_a_displacement_over_a_displacement(
    tmp_path: Path,
) -> None:
    responses = [
        frequency_response(SYSTEM, (3.0, 4.5), d.name, "x", drives="in place") for d in STAGE.drives
    ]
    for f in of_kind(read(frf_file(STAGE, responses), tmp_path), 58):
        assert f["orddenom_spec_data_type"] == 8
        assert "free displacement, drives in place" in f["id2"]


def test_what_moves_out_of_the_plane_is_written(tmp_path: Path) -> None:
    """A model in three dimensions says the lift of a probed body by a reading of its own."""
    port = SYSTEM.bodies[3]
    lift = np.linspace(-1.3, 2.1, SYSTEM.order)
    probe = replace(SYSTEM.probes[0], name=f"{port.name} out of plane", vector=lift)
    system = replace(SYSTEM, probes=(*SYSTEM.probes, probe))
    found = modes(system, count=2)
    (first, _) = of_kind(read(modal_file(STAGE, system, found), tmp_path), 55)
    owner = np.array(modal_points(STAGE).body)
    z = shape_of(first)[:, 2]
    assert z[owner == port.name] == pytest.approx(lift @ found.shapes[:, 0], rel=SIX)
    assert not z[owner != port.name].any()


def test_long_lines_are_parted_where_the_format_demands_it() -> None:
    points = list(range(1, 601))
    text = trace_lines(5, "outline", points)
    parts = [p.split("\n") for p in text.split("    -1\n    82\n")[1:]]
    assert [int(p[0].split()[0]) for p in parts] == [5, 6, 7]
    joined: list[int] = []
    for p in parts:
        nodes = [int(w) for line in p[2:-2] for w in line.split()]
        assert len(nodes) == int(p[0].split()[1]) <= 250
        assert not joined or joined[-1] == nodes[0]  # no gap between two parts
        joined += nodes if not joined else nodes[1:]
    assert joined == points


def test_an_axis_that_turns_is_a_rotation_about_z_over_a_force(tmp_path: Path) -> None:
    stage = design("three-rrr")
    system = lumped_system(stage)
    files = universal_files(stage, system, count=6)
    functions = of_kind(read(files["three-rrr-frf.uff"], tmp_path), 58)
    columns = {c.name: c for c in read_universal(tmp_path / "file.uff", "2,5,8").columns}
    assert [f["rsp_dir"] for f in functions] == 3 * [1, 2, 6]
    points = modal_points(stage).numbers
    shapes = of_kind(read(files["three-rrr-modes.uff"], tmp_path), 55)
    found = modes(system, count=6)
    for f, drive in zip(functions[2::3], stage.drives, strict=True):
        exact = frequency_response(system, f["x"], drive.name, "theta").value
        assert np.abs(f["data"] / exact - 1.0).max() < 2 * THIRTEEN
        assert "about z" in f["id4"]
        assert (f["ordinate_axis_lab"].strip(), f["ordinate_axis_units_lab"].strip()) == (
            "rotation",
            "rad",
        )
        code = {0: "", 1: ":+x", 2: ":+y"}[f["ref_dir"]]
        name = f"{points['probe', 'theta']}:+rz/{points['drive', drive.name]}{code}"
        assert columns[f"{name} real"].unit == "rad/N"
    for k, mode in enumerate(shapes):
        turn = system.probe("theta").vector @ found.shapes[:, k]
        assert shape_of(mode)[points["probe", "theta"] - 1, 5] == pytest.approx(turn, rel=SIX)


def test_names_are_plain_text_of_80_characters_and_the_file_is_the_same_each_time(
    tmp_path: Path,
) -> None:
    odd: Stage = replace(STAGE, name="Tischführung µ " + "long " * 30, title="-1")
    system = replace(SYSTEM, name=odd.name)
    first = universal_files(odd, system, count=1)
    assert first == universal_files(odd, system, count=1)
    for name, content in first.items():
        if name.endswith(".uff"):
            lines = content.decode("ascii").split("\n")
            assert max(map(len, lines)) <= 81
            (heading,) = of_kind(read(content, tmp_path), 151)
            written = (heading["date_file_written"], heading["time_file_written"])
            assert written == ("01-JAN-70", "00:00:00")


def test_what_cannot_be_written_is_refused_in_one_sentence() -> None:
    foreign = replace(frequency_response(SYSTEM, (1.0, 2.0), "x", "x"), probe="z")
    with pytest.raises(StageError, match="'z', which does not exist"):
        frf_file(STAGE, [foreign])
