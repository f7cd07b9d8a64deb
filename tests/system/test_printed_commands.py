"""Every command of README and manual, as it is printed, with its defaults."""

import contextlib
import functools
import io
import json
import math
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from filelock import FileLock

from flexstage.base.provenance import content_hash
from flexstage.cli import main
from flexstage.files.cache import open_cache
from tests.meta.test_docs_snippets import PAGES, ROOT, Block, blocks, session
from tests.printed_commands import Command, Shell, commands, differences
from tests.undrawn import undrawn

_SHELLS = ("console", "bash", "sh")
#: Commands that need more than a minute of computing, by what they hold: `make evidence` runs them.
_LONG = ("--stroke", "--model solid", "flexstage study", "--quantity max_stress", "flexor_025.step")
#: Files of CAD that the reader of a page has and nobody else, by a command that names them.
_THEIRS = ("actuator.step", 'joint.step --material "E=193 GPa')
#: Commands of the project itself, which other tests and targets are, and those that set up Python.
_OURS = (
    "make ", "pytest ", "python -m benchmarks", "pip install", "python3 -m venv", "source ",
    "export ",
)  # fmt: skip
#: What is not on this machine, and the sentence that says so.
_ELSEWHERE = {
    "192.168.0.10": "cannot connect to 192.168.0.10",
    "runs show 71d7": "no run of the catalogue",
    "runs add runs/2031": "there is no folder",
}
#: What two pages print of: the first one that comes to it keeps what is said for the other.
_TWICE = ("flexstage analyse vgtu-piezo --model plane --accuracy 0.1%",)
#: What writes many figures, which other tests draw.
_FIGURES = ("flexstage run ", "flexstage characterise ", "flexstage new --folder ")
#: What stays, by the line that says that it is ready, and what keeps it from opening a window.
_SERVES = {
    "flexstage twin ": (r"at gcs://(\S+) \(simulated\)", ""),
    "flexstage serve": (r"at http://(127\.0\.0\.1:\d+)/\?token=", " --no-open"),
}
#: Where a twin listens, as it is printed: a port that another program may have, or another page.
_PRINTED = "127.0.0.1:50000"
_LIMIT = 300.0
_FILE = re.compile(r"[\w.-]+\.(?:csv|dat|h5|step|txt|yaml)\b")


def measured(file: Path, rates: tuple[float, ...] = (0.5, 5.0)) -> None:
    """A drive record of a virtual stack, as a bench has it."""
    from flexstage.hysteresis import LogCreep, Sensor, excitation
    from flexstage.records import Channel, Record, write_record
    from flexstage.virtual import virtual_stack

    drive = excitation(
        (0.0, 120.0), sample_rate=1000.0, duration=25.0, rates=rates,
        frequency=640.0, multisine=False,
    )  # fmt: skip
    free = virtual_stack((0.0, 120.0), 38e-6, 0.13).simulate(drive.voltage).values
    moved = LogCreep(rate_per_decade=0.015).simulate(free, 1e-3).values
    read = Sensor(bandwidth_hz=300.0, noise_rms=8e-9, offset=3.1e-6, seed=4).simulate(moved, 1e-3)
    position = Channel(name="position", values=read.values, unit="m")
    voltage = Channel(name="voltage", values=drive.voltage, unit="V")
    write_record(Record(channels=(voltage, position), time=drive.time), file)


def by(*words: object) -> None:
    """Run a command to make a file."""
    with contextlib.redirect_stdout(io.StringIO()), pytest.raises(SystemExit) as end:
        main([str(word) for word in words])
    assert not end.value.code, words


@functools.cache
def identified() -> bytes:
    """What `identify` writes of such a record."""
    with tempfile.TemporaryDirectory() as folder:
        record, found = Path(folder) / "record.csv", Path(folder) / "model.yaml"
        measured(record)
        by("identify", record, "--input", "voltage", "--output", "position", "--model", "preisach",
           "--out", found)  # fmt: skip
        return found.read_bytes()


def model(file: Path) -> None:
    """The model file of such a record."""
    file.write_bytes(identified())


def wanted(file: Path) -> None:
    """Six cycles of 30 um that a drive is to follow."""
    t = np.arange(6000) * 1e-3
    rows = np.column_stack([t, 25.0 - 15.0 * np.cos(2.0 * math.pi * t)])
    np.savetxt(file, rows, delimiter=",", header="time [s],wanted [um]", comments="")


def logged(file: Path) -> None:
    """A loop that a computer logged about ten times in a second."""
    rng = np.random.default_rng(1)
    t = np.cumsum(0.1 * (1.0 + 0.1 * rng.uniform(-1.0, 1.0, 2400)))
    u = 60.0 - 60.0 * np.cos(2.0 * math.pi * 0.05 * t)
    from flexstage.virtual import virtual_stack

    y = 1e6 * virtual_stack((0.0, 120.0), 38e-6, 0.13).simulate(u).values
    y += rng.normal(0.0, 0.02, y.size)
    np.savetxt(file, np.column_stack([t, u, y]), delimiter=",", comments="",
               header="time [s],u [V],y [um]")  # fmt: skip


def branches(file: Path) -> None:
    """A quasi-static loop as a table of its two branches."""
    v = np.linspace(0.0, 100.0, 101)
    bow = 2.5 * (1.0 - ((v - 50.0) / 50.0) ** 2)
    rows = np.column_stack([v, 0.3 * v - bow, 0.3 * v + bow])
    np.savetxt(file, rows, delimiter=",", comments="", header="voltage [V],up,down")


def scale(file: Path) -> None:
    """The error of an encoder with four heads over a turn."""
    theta = np.radians(np.arange(720) / 2.0)
    heads = [0.05 * np.cos(theta + np.radians(a) - 0.9) for a in (0, 92, 178, 275)]
    rows = np.column_stack([np.degrees(theta), *heads])
    np.savetxt(file, rows, delimiter=",", comments="", header="angle,h1,h2,h3,h4")


def magnet(file: Path) -> None:
    """The error of a magnet over four probes, at a position of the stage."""
    from tests.dipole import STOOD, THETA, dipole_at

    rng = np.random.default_rng(int(file.stem[1:]))
    error = dipole_at(STOOD[int(file.stem[1:])], "four", "magnet")
    error = error + rng.normal(0.0, np.radians(0.01), THETA.size)
    np.savetxt(file, np.degrees([THETA, error]).T, delimiter=",", comments="",
               header="angle,error")  # fmt: skip


def stage(name: str) -> Callable[[Path], None]:
    """A stage file, of a design."""

    def write(file: Path) -> None:
        from flexstage.stage import write_stage
        from flexstage.stage.designs import design

        write_stage(design(name), file)

    return write


def torn(file: Path) -> None:
    """The stream of a record whose writer was ended in the middle."""
    from flexstage.instruments.recording.metadata import RunMetadata
    from flexstage.instruments.recording.writer import RunWriter

    file.parent.mkdir(parents=True)
    about = RunMetadata(
        stage="rk9", instrument={"vendor": "bench", "model": "1"}, kind="loops", axis="x"
    )
    channels = [("u", "V"), ("x", "m"), ("y", "m")]
    with tempfile.TemporaryDirectory() as folder:
        writer = RunWriter(Path(folder) / file.name, channels, 1000.0, about)
        for first, count in ((0, 1965), (1965, 1000)):
            writer.append(first, {name: np.arange(count) * 1e-9 for name, _ in channels})
        file.write_bytes((Path(folder) / file.name).read_bytes()[:-100])
        writer.close()


def interrupted(folder: Path) -> None:
    """A run that was ended in its last step, made of the run before it."""
    shutil.copytree(folder.with_name("first-run"), folder)
    state = json.loads((folder / "run.json").read_text("utf-8"))
    *_, ended = state["steps"]
    assert ended == "control-y"
    for record in state["steps"][ended]["files"]:
        (folder / record).unlink()
    state["steps"][ended] |= {"status": "interrupted", "files": {}}
    state["finished"] = ""
    (folder / "run.json").write_text(json.dumps(state), "utf-8")


def taken_up(folder: Path) -> None:
    """What both runs say afterwards: the second has every step, and repeated none that it had."""
    reached(folder / "first-run")
    first, second = (
        json.loads((folder / name / "run.json").read_text("utf-8"))["steps"]
        for name in ("first-run", "second-run")
    )
    assert list(second) == list(first)
    assert {step["status"] for step in second.values()} == {"complete"}
    again = [name for name in first if second[name] != first[name]]
    assert again == ["control-y"]


def reached(folder: Path) -> None:
    """What the whole plan of the piezo stage is for."""
    result = json.loads((folder / "results.json").read_text("utf-8"))
    figures = {(f["quantity"], f["axis"]): f["value"] for f in result["figures"]}
    for axis, stroke, frequency in (("x", 63.12e-6, 337.0), ("y", 60.9e-6, 526.93)):
        assert figures["output_displacement", axis] == pytest.approx(stroke, rel=0.08)
        assert figures["natural_frequency_hz", axis] == pytest.approx(frequency, rel=0.05)
    runs = {
        (s["name"], r["mode"]): (r, s["stroke"])
        for s in result["steps"] if s["verb"] == "verify" for r in s["runs"]
    }  # fmt: skip
    for axis in "xy":
        # the study: 93.9 and 94.3 % by the inverse of its Bouc-Wen model
        assert runs[f"inverse-bouc-wen-{axis}", "inverse"][0]["reduction_percent"] > 93.0
        best, stroke = runs[f"inverse-preisach-{axis}", "inverse"]
        assert best["reduction_percent"] > 98.5
        assert best["tracking_rms"] < 0.005 * stroke
        # 5 nm of the sensor and 10 nm of the mains are in what it reads
        assert runs[f"control-{axis}", "both"][0]["tracking_rms"] < 25e-9
        assert runs[f"control-{axis}", "learning"][0]["tracking_rms"] < 25e-9
    page = (folder / "report.html").read_text("utf-8")
    # every loop beside what was published of it, and the model beside its own
    cells = ("<td>0.43</td>", "<td>7.91</td>", "<td>1.05</td>")
    for text in ("published, axis y: inverse of Bouc-Wen", *cells):
        assert text in page, text
    assert page.count('class="plot"') > 30


def repository(file: Path) -> None:
    """A file of the repository, in whose root a command is printed."""
    parts = file.parts
    file.parent.mkdir(parents=True, exist_ok=True)
    shutil.copy(ROOT / Path(*parts[parts.index("examples") :]), file)


def solid(file: Path) -> None:
    """A joint with a round notch as a STEP file, which takes less time than a guide."""
    from netgen.occ import Axes, Box, Cylinder, Pnt, X, Y

    joint = Box(Pnt(0.0, 0.0, 0.0), Pnt(10.0, 6.0, 20.0))
    for x in (0.5, 9.5):
        joint -= Cylinder(Axes(Pnt(x, 0.0, 10.0), Y, X), 3.5, 6.0)
    joint.WriteStep(str(file))


def cycles_plan(file: Path) -> None:
    """A plan of cycles, for a card."""
    file.write_text(
        "plan: 1\nstage: vgtu-piezo\ntitle: cycles\n"
        "sensors:\n  x: {channel: 1}\n  y: {channel: 2}\n"
        "steps:\n  - {name: cycles, excite: {kind: cycles, axis: x, rate: 1 Hz, cycles: 3}}\n"
        "  - {name: motion, measure: {of: cycles, along: x}}\n",
        "utf-8",
    )


def bad_plan(file: Path) -> None:
    """The plan of the page with a step misspelt."""
    text = file.with_name("first.yaml").read_text("utf-8")
    file.write_text(text.replace("of: cycles", "of: cycle"), "utf-8")


def public(file: Path) -> None:
    """A file of the folder of shared data."""
    found = sorted((ROOT.parent / "shared" / "data").glob(f"*/{file.name}"))
    if not found:
        pytest.skip(f"the public file {file.name} is not here")
    shutil.copy(found[0], file)


#: Files that the reader of a page has. They are not those of the page: its figures are others.
GIVEN: dict[str, dict[str, Callable[[Path], None]]] = {
    "compensate.md": {"stack.yaml": model, "reference.csv": wanted},
    "identify.md": {"logged.csv": logged, "loop.csv": branches},
    "identification.md": {"Test_Vi_Do_Di.dat": public},
    "export.md": {"x.yaml": model, "y.yaml": model, "mine.yaml": stage("parallelogram")},
    "use-the-twin.md": {"mine.yaml": stage("vgtu-piezo")},
    # what the command before it has made, which is quick and was run apart
    "from-a-drawing.md": {"parallelogram.yaml": stage("parallelogram")},
    "centre.md": {f"r{k}.csv": magnet for k in range(5)},
    "keep-records.md": {"rk9/records/loops-x.stream": torn},
    "finite-elements.md": {"joint.step": solid},
    "ansys-comparison.md": {"flexor_025.step": public},
    "published-stages.md": {
        f"examples/published/{name}": repository
        for name in ("two-leaf-parallelogram.yaml", "parts.py")
    },
    "write-a-plan.md": {"bad.yaml": bad_plan},
    "ni-acquisition.md": {"mine.yaml": cycles_plan},
    "run-the-piezo-stage.md": {"second-run": interrupted},
}
#: What a page says of its files when it is at its end.
AFTER: dict[str, Callable[[Path], None]] = {"run-the-piezo-stage.md": taken_up}
#: Pages whose given files are the page's own: figures are compared as well.
_OWN = ("identification.md",)
#: Time passes there as commands come: figures differ by noise from run to run, by this at most.
_NOISY = "gcs://"
_NOISE = 0.5


def pages() -> list[Path]:
    return [p for p in PAGES if any(b.language in _SHELLS for b in blocks(p.read_text("utf-8")))]


class Page:
    """One page in its folder."""

    def __init__(self, path: Path, folder: Path, *, long: bool) -> None:
        self.name, self.folder, self.long = path.name, folder, long
        self.blocks = blocks(path.read_text("utf-8"))
        scripts = str(Path(sys.executable).parent)
        self.shell = Shell(
            folder,
            {
                "PATH": f"{scripts}{os.pathsep}{os.environ['PATH']}",
                "MPLBACKEND": "agg",
                "COLUMNS": "80",  # as a terminal has it
                "FLEXSTAGE_CATALOGUE": f"{folder}/.catalogue.sqlite",
                "FLEXSTAGE_STATE": f"{folder}/.state",
            },
        )
        self.given = GIVEN.get(path.name, {})
        self.address = _PRINTED
        self.names: dict[str, Any] = {"__name__": "__snippet__"}
        self.python: list[Block] = []
        self.faults: list[str] = []
        self.later: list[Command] = []
        self.ran = 0

    def run(self) -> None:
        """Run the page from top to bottom; then what had to wait for a file of it."""
        try:
            for at, block in enumerate(self.blocks):
                self.write(block)
                if block.language in ("python", "pycon"):
                    self.python.append(block)
                elif block.language in _SHELLS:
                    found = commands(block.code)
                    if found and not any(c.printed for c in found):
                        for below in self.blocks[at + 1 :]:
                            if not self.printed(block, below):
                                break
                            found[-1].printed.extend(below.code.splitlines())
                    for command in found:
                        self.do(command, wait=True)
                    self.shell.folder = self.folder
            for command in self.later:
                self.do(command, wait=False)
        finally:
            self.shell.end()

    def write(self, block: Block) -> None:
        header = re.match(r"(?:#|//|<!--) file: (\S+)", block.code)
        if header:
            (self.folder / header[1]).write_text(block.code, encoding="utf-8")

    def awaited(self, line: str) -> bool:
        """Whether a command reads a file that the Python above writes, by its line or a plan."""
        above = "".join(block.code for block in self.python)
        plans = [self.folder / name for name in _FILE.findall(line) if name.endswith(".yaml")]
        texts = [line, *(plan.read_text("utf-8") for plan in plans if plan.is_file())]
        names = {name for text in texts for name in _FILE.findall(text)}
        return any(name in above and not (self.folder / name).exists() for name in names)

    def run_python(self) -> None:
        """Run the Python above; another test runs that of every page."""
        for block in self.python:
            if ">>> " in block.code:
                session(block, self.names, self.name)
            else:
                exec(compile(block.code, self.name, "exec"), self.names)
        self.python.clear()

    def printed(self, block: Block, below: Block) -> bool:
        """Whether a block of text below a command is what it prints, and no list of files."""
        listing = re.match(r"\S+/\n", below.code)
        return below.language == "text" and not listing and not block.code.startswith("make")

    def do(self, command: Command, *, wait: bool) -> None:
        line = command.line.partition("  #")[0].strip()
        if not line or line.startswith(("#", *_OURS)) or any(word in line for word in _THEIRS):
            return
        # what writes a stage is needed by the long commands as well
        short = line.startswith("flexstage") and not line.startswith("flexstage new")
        if short and any(word in line for word in _LONG) != self.long:
            return
        made = [name for name in self.given if name in line]
        for name in made:
            if not (self.folder / name).exists():
                self.given[name](self.folder / name)
        if self.awaited(line):
            self.run_python()
        if wait and self.missing(line):
            self.later.append(command)
            return
        self.ran += 1
        for start, (told, more) in _SERVES.items():
            if not line.startswith(start) or "--play" in line:
                continue
            said = self.shell.serve(line + more + ("" if "--address" in line else " --address 0"))
            ready = re.search(told, said)
            if ready is None:
                self.faults.append(f"{line}: no line that it is ready, but {said!r}")
            else:
                self.address = ready[1]
            return
        run = self.kept if line in _TWICE else self.shell.run
        with undrawn() if line.startswith(_FIGURES) else contextlib.nullcontext():
            done = run(line.replace(_PRINTED, self.address), _LIMIT)
        said = (done.stdout + done.stderr).replace(self.address, _PRINTED)
        self.judge(command, line, done.returncode, said, own=not made)

    def kept(self, line: str, limit: float) -> subprocess.CompletedProcess[str]:
        """Run a command that reads and makes no file of the page, or say what it said."""
        cache = open_cache(True)
        assert cache is not None
        file = cache.directory / f"said-{content_hash(line)}.json"
        file.parent.mkdir(parents=True, exist_ok=True)
        with FileLock(file.with_suffix(".lock")):
            if not file.exists():
                done = self.shell.run(line, limit)
                file.write_text(json.dumps([done.returncode, done.stdout, done.stderr]), "utf-8")
            return subprocess.CompletedProcess(line, *json.loads(file.read_text("utf-8")))

    def missing(self, line: str) -> bool:
        """Whether it reads a file that the page has not made yet."""
        read = re.sub(r"(?:--(?:out|figure)|>) \S+", "", line)
        files = re.findall(r"(?<=[\s=])[\w.-]+\.(?:csv|yaml|step|dat)\b", read)
        return any(not (self.folder / name).exists() for name in files)

    def judge(self, command: Command, line: str, status: int, said: str, *, own: bool) -> None:
        if "Traceback" in said:
            self.faults.append(f"{line}: {said[-2000:]}")
            return
        for word, sentence in _ELSEWHERE.items():
            if word in line:
                if status == 0 or sentence not in said:
                    self.faults.append(f"{line}: status {status}, not '{sentence}': {said[-500:]}")
                return
        refused = any(text.startswith(("flexstage: ", "error: ")) for text in command.printed)
        if (status != 0) != refused:
            self.faults.append(f"{line}: status {status}: {said[-800:]}")
            return
        missed = differences(
            command.printed, said, digits=own or self.name in _OWN,
            noise=_NOISE if _NOISY in line else 0.0,
        )  # fmt: skip
        if missed:
            self.faults.append(f"{line}: printed, and did not come: {missed}\n{said[-3000:]}")


def checked(path: Path, folder: Path, monkeypatch: pytest.MonkeyPatch, *, long: bool) -> Page:
    monkeypatch.chdir(folder)
    monkeypatch.setenv("MPLBACKEND", "agg")
    page = Page(path, folder, long=long)
    page.run()
    assert not page.faults, "\n\n".join(page.faults)
    if not long:
        AFTER.get(path.name, lambda folder: None)(folder)
    return page


@pytest.mark.slow
@pytest.mark.parametrize("path", pages(), ids=lambda page: page.name)
def test_commands_run_as_printed(
    path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    checked(path, tmp_path, monkeypatch, long=False)


LONG = [p for p in pages() if any(word in p.read_text("utf-8") for word in _LONG)]


@pytest.mark.evidence
@pytest.mark.parametrize("path", LONG, ids=lambda page: page.name)
def test_long_commands_run_as_printed(
    path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    checked(path, tmp_path, monkeypatch, long=True)
