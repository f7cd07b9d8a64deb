"""What the program gives for the two stages of the study, frozen, to be compared afterwards.

    python -m tests.golden.baseline freeze [NAME ...]   run, and write baseline/NAME.json
    python -m tests.golden.baseline check  [NAME ...]   run, and print what differs; status 1 if any
    python -m tests.golden.baseline times LOG           keep the slowest tests of a log of pytest

A rebuild that moves no number prints "the same" for every name. Text is compared but for times,
paths and checksums; numbers within `CLOSE` of their size. A run on the twin, whose time passes as
ours does, repeats within its own uncertainty. All names take half an hour on two cores.
"""

import hashlib
import io
import json
import os
import re
import subprocess
import sys
import tempfile
import zipfile
from collections import defaultdict
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import scipy.io

#: Largest relative change of a number that is none.
CLOSE = 1e-9
#: Arrays and columns with more numbers than this are kept as sums over blocks.
MOST = 400
BLOCKS = 64
#: Largest change of a figure that a run on the twin measures, in its standard uncertainties; one
#: that has few degrees of freedom may change by the width of its interval.
REPEATS = 5.0
#: Differences that are printed of each name.
SHOWN = 12
FOLDER = Path(__file__).with_name("baseline")
STAGES = ("vgtu-mechanical", "vgtu-piezo")
MODELS = ("lumped", "superelement", "plane", "solid")
#: Parts of a line that change from run to run: times, folders, checksums, durations.
VOLATILE = re.compile(
    r"\d{4}-\d\d-\d\d[T ]\d\d:\d\d[\d:.+Z-]*|\d{4}-\d\d-\d\d|(?:/[\w.+-]+){2,}"
    r"|(?<![\w.])(?=\d*[a-f])[0-9a-f]{16,64}\b|\{[0-9a-fA-F-]{36}\}"
    r"|\b[\d.]+ (?:s|min)\b(?= ago| so far)"
)
#: Keys of results that are of the run and not of the stage.
OF_THE_RUN = {
    "created", "started", "finished", "duration", "elapsed", "seconds", "host", "version",
    "time_utc", "wall_time", "cpu_time", "commit", "file", "path", "folder", "input_hash",
}  # fmt: skip
#: Keys that name an item of a list.
NAMES = ("quantity", "name", "key", "hinge", "step", "axis", "model")
#: Files of pictures, of compiled code, or whose numbers stand elsewhere as well.
SKIPPED = (".html", ".png", ".pdf", ".so", ".dll", ".dylib", ".lock", ".log", ".stream", ".sqlite")
NUMBER = re.compile(r"(?<![\w.])[-+\N{MINUS SIGN}]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?(?![\w])")


class Leaf(NamedTuple):
    """One file or answer: a checksum of its words, and its numbers by array or column."""

    words: str
    families: dict[str, np.ndarray]

    def size(self) -> int:
        return sum(values.size for values in self.families.values())


def work() -> dict[str, list[list[str]]]:
    """Return the commands of each name; {out} is its folder."""
    names: dict[str, list[list[str]]] = {}
    for stage in STAGES:
        names[f"{stage}-check"] = [["check", stage, "--json"]]
        names[f"{stage}-equations"] = [["equations", stage, "--json"]]
        for model in MODELS:
            names[f"{stage}-{model}"] = [["analyse", stage, "--model", model, "--json"]]
        names[f"{stage}-export"] = [["export", stage, "--to", "all", "--folder", "{out}"]]
        names[f"{stage}-study"] = [["study", stage, "--folder", "{out}", "--no-cache", "--json"]]
        names[f"{stage}-run"] = [["run", stage]]
    return names


def carry_out(command: list[str], out: Path) -> str:
    """Run one command of flexstage; return what it printed."""
    if command[0] == "run":
        return on_the_twin(command[1], out)
    line = [part.format(out=out) for part in command]
    return flexstage(*line)


def flexstage(*words: str) -> str:
    # sums over threads differ in the last digits, and cores are taken as they are free
    done = subprocess.run(
        [sys.executable, "-m", "flexstage", *words],
        stdout=subprocess.PIPE, text=True, check=True,
        env={**os.environ, "OPENBLAS_NUM_THREADS": "1", "NGS_NUM_THREADS": "1"},
    )  # fmt: skip
    return done.stdout


def on_the_twin(stage: str, out: Path) -> str:
    """Carry out the ready plan of a stage on its twin, whose noise is drawn from seed 1."""
    twin = subprocess.Popen(
        [sys.executable, "-m", "flexstage", "twin", stage, "--seed", "1", "--address", "0",
         "--identity", "flexstage"],  # which has a hammer for every stage
        stdout=subprocess.PIPE, text=True,
    )  # fmt: skip
    try:
        assert twin.stdout is not None
        found = re.search(r"gcs://\S+", twin.stdout.readline())
        assert found is not None, "the twin gave no address"
        return flexstage(
            "run", stage, "--instrument", found[0], "--folder", str(out / "run"), "--json", "--yes"
        )
    finally:
        twin.terminate()
        twin.wait()


def leaves(answer: str, out: Path) -> Iterator[tuple[str, Leaf]]:
    """Return the answer and every file below a folder, by name."""
    yield "answer", leaf("answer.json" if answer.startswith("{") else "answer.txt", answer.encode())
    for path in sorted(out.rglob("*")):
        if path.is_file():
            yield from parts(str(path.relative_to(out)), path.read_bytes())


def parts(name: str, data: bytes) -> Iterator[tuple[str, Leaf]]:
    """Return a file, or the members of an archive."""
    if name.endswith(SKIPPED):
        return
    if zipfile.is_zipfile(io.BytesIO(data)):
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            for member in sorted(archive.namelist()):
                if not member.endswith("/"):
                    yield from parts(f"{name}/{member}", archive.read(member))
        return
    yield name, leaf(name, data)


def leaf(name: str, data: bytes) -> Leaf:
    """Divide a file into its words and its numbers."""
    if name.endswith(".json"):
        return from_lines(list(flat(json.loads(data))))
    if name.endswith(".mat"):
        return from_lines(list(flat(scipy.io.loadmat(io.BytesIO(data), simplify_cells=True))))
    try:
        text = data.decode("utf-8")
    except UnicodeDecodeError:
        return Leaf(hashlib.sha256(data).hexdigest()[:16], {})
    return from_lines([("", line) for line in text.splitlines()])


def flat(node: Any, path: str = "") -> Iterator[tuple[str, str]]:
    """Return the leaves of nested mappings and lists as text, each with its path."""
    if isinstance(node, np.ndarray):
        node = node.tolist()
    if isinstance(node, dict):
        for key, value in node.items():
            if key not in OF_THE_RUN and not key.startswith("__"):
                yield from flat(value, f"{path}.{key}")
    elif isinstance(node, list | tuple):
        for k, value in enumerate(node):
            yield from flat(value, f"{path}[{title(value) or k}]")
    elif isinstance(node, complex):
        yield path, f"{node.real!r} {node.imag!r}"
    else:
        yield path, str(node)


def title(node: Any) -> str:
    """What an item of a list is called, by its keys: items of one name are one family."""
    words = [str(node[key]) for key in NAMES if key in node] if isinstance(node, dict) else []
    return " ".join(words) if all(not w.isdigit() for w in words) else ""


def from_lines(lines: Iterable[tuple[str, str]]) -> Leaf:
    """Numbers of one array, or of one column of a text, are a family."""
    words, families = hashlib.sha256(), defaultdict(list)
    for place, text in lines:
        line = VOLATILE.sub("…", text)
        name = re.sub(r"\[\d+\]", "[]", place)
        for k, number in enumerate(NUMBER.findall(line)):
            families[f"{name} #{k}"].append(float(number.replace("\N{MINUS SIGN}", "-")))
        words.update(NUMBER.sub("#", line).encode() + b"\n")
    return Leaf(words.hexdigest()[:16], {name: np.array(v) for name, v in families.items()})


def kept(one: Leaf) -> dict[str, Any]:
    """Return what is written of a file: its words, and its families of numbers."""
    return {"words": one.words, "numbers": {n: family(v) for n, v in one.families.items()}}


def family(values: np.ndarray) -> dict[str, Any] | list[float]:
    if values.size <= MOST:
        return [float(f"{x:.12g}") for x in values]
    found, sizes = sums(values)
    return {"count": values.size, "sums": found.tolist(), "sizes": sizes.tolist()}


def sums(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return weighted sums over blocks, and the size that each is compared with."""
    weights = 1.0 + np.modf(np.arange(values.size) * 0.6180339887498949)[0]
    return (
        np.array([float(np.sum(b)) for b in np.array_split(values * weights, BLOCKS)]),
        np.array([float(np.sum(np.abs(b))) for b in np.array_split(values, BLOCKS)]),
    )


def differences(was: dict[str, Any], one: Leaf) -> list[str]:
    """Return what differs from what was kept, in words."""
    found = [] if was["words"] == one.words else ["the words differ"]
    for name, old in was["numbers"].items():
        values = one.families.get(name)
        if values is None:
            found.append(f"{name}: is no more")
        elif fault := moved(old, values):
            found.append(f"{name}: {fault}")
    return found + [f"{name}: is new" for name in one.families if name not in was["numbers"]]


def measured(was: dict[str, Any], one: Leaf) -> list[str]:
    """Return the figures of a run that differ by more than their uncertainty explains."""
    found = []
    for name, old in was["numbers"].items():
        if not name.startswith(".figures[") or not name.endswith(".value #0"):
            continue
        u = was["numbers"].get(name.replace(".value", ".uncertainty"), [0.0])
        interval = was["numbers"].get(name.replace(".value", ".interval[]"), old)
        room = max(REPEATS * u[0], max(interval) - min(interval))
        values = one.families.get(name)
        if values is None:
            found.append(f"{name}: is no more")
        elif (np.abs(values - old) > room).any():
            found.append(f"{name}: {old[0]:.6g} +- {u[0]:.2g}, now {values[0]:.6g}")
    return found


def moved(old: dict[str, Any] | list[float], values: np.ndarray) -> str:
    """Return how a family differs from what was kept of it; nothing where it does not."""
    count = len(old) if isinstance(old, list) else old["count"]
    if count != values.size:
        return f"{count} numbers, now {values.size}"
    if isinstance(old, list):
        was, now, size = np.array(old), values, np.abs(old).max(initial=0.0)
    else:
        now, _ = sums(values)
        was, size = np.array(old["sums"]), np.array(old["sizes"])
    change = np.abs(now - was)
    if not (change > CLOSE * size).any():
        return ""
    worst = int(np.argmax(change))
    return f"{was[worst]:.12g}, now {now[worst]:.12g}"


def freeze(name: str, found: dict[str, Leaf]) -> bool:
    """Write what was found."""
    FOLDER.mkdir(exist_ok=True)
    lines = (f"{json.dumps(file)}: {json.dumps(kept(one))}" for file, one in found.items())
    text = "{\n" + ",\n".join(lines) + "\n}"
    (FOLDER / f"{name}.json").write_text(text + "\n", "utf-8")
    print(f"{name}: {len(found)} files, {sum(x.size() for x in found.values())} numbers kept")  # noqa: T201
    return True


def check(name: str, found: dict[str, Leaf]) -> bool:
    """Print what differs from what was frozen; whether nothing does."""
    was = json.loads((FOLDER / f"{name}.json").read_text("utf-8"))
    faults = [f"{file}: is new" for file in found if file not in was]
    faults += [f"{file}: is no more" for file in was if file not in found]
    compare = measured if name.endswith("-run") else differences
    for file in found.keys() & was.keys():
        faults += [f"{file}: {fault}" for fault in compare(was[file], found[file])]
    verdict = f"{len(faults)} differences" if faults else "the same"
    print("\n  ".join([f"{name}: {verdict}", *sorted(faults)[:SHOWN]]))  # noqa: T201
    return not faults


def times(log: Path) -> None:
    """Keep the hundred slowest tests of a log that pytest wrote with --durations."""
    found = re.findall(r"^([\d.]+)s (call|setup) +(\S+)", log.read_text("utf-8"), re.MULTILINE)
    slowest = sorted(found, key=lambda row: -float(row[0]))[:100]
    FOLDER.mkdir(exist_ok=True)
    lines = [f"{seconds:>8} s  {phase:5}  {test}" for seconds, phase, test in slowest]
    (FOLDER / "slowest.txt").write_text("\n".join(lines) + "\n", "utf-8")


def main(words: list[str]) -> int:
    """Run the names asked for; 0 where all are the same."""
    act, *rest = words or ["--help"]
    wrong = set() if act == "times" else set(rest) - set(work())
    if act not in ("freeze", "check", "times") or wrong:
        sys.stderr.write(f"{__doc__}\nnames: {', '.join(work())}\n")
        return 2
    if act == "times":
        times(Path(rest[0]))
        return 0
    todo = {name: lines for name, lines in work().items() if not rest or name in rest}
    same = True
    for name, lines in todo.items():
        with tempfile.TemporaryDirectory() as folder:
            out = Path(folder) / "out"
            out.mkdir()
            answers = "\n".join(carry_out(line, out) for line in lines)
            found = dict(leaves(answers, out))
        same &= {"freeze": freeze, "check": check}[act](name, found)
        sys.stdout.flush()
    return 0 if same else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
