"""What is said of broken files, frozen, so that no message becomes worse unseen.

    python -m tests.golden.broken_files freeze [KIND ...]   read them, and write broken/KIND.txt
    python -m tests.golden.broken_files check  [KIND ...]   read them, and print what changed

A block of such a file is a case: how the valid file in `tests.golden.broken_cases` is broken, and
the sentence that the command line prints of it, after the name of the error. What another library
says in it is left out where it changes with the library.
"""

import re
import struct
import sys
import tempfile
import warnings
import zlib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from flexstage.base.errors import FlexstageError
from flexstage.centring import read_table
from flexstage.experiments import plan_stage, read_campaign, read_plan
from flexstage.experiments.runner import read_state
from flexstage.hysteresis.model_file import read_model_file
from flexstage.instruments.recording.archive import examine, file_summary
from flexstage.measure import read_budget
from flexstage.stage.designs.source import find_stage
from tests.golden.broken_cases import (
    budget,
    campaign,
    design,
    hysteresis_model,
    plan,
    plan_state,
    run_metadata,
    stage,
    stage_parameters,
    table,
)
from tests.golden.broken_cases.ways import ANY_JSON, ANY_YAML, Edit

FOLDER = Path(__file__).with_name("broken")
#: What stands for the folder of a broken file.
HERE = "FOLDER"
#: What the valid file is called among the broken ones.
SOUND = "nothing is broken"
#: What is frozen of a file that is read in spite of all.
READ = "is read"
#: What is frozen where an error came that is not one of the package's own.
CRASH = "CRASH"
#: Words that change from run to run, or with the release of a library, and what stands for them.
VOLATILE = {
    r"such as \d{4}-\d\d-\d\dT[\d:.+]+": "such as NOW",
    r"maximum recursion depth exceeded[^)']*": "WORDS OF THE LIBRARY",
    r"(?:\[Errno \d+\] )?\"?Unable to (?:synchronously )?open .*": "WORDS OF THE LIBRARY)",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Kind:
    """A kind of file."""

    file: str
    """What a file of it is called."""
    text: str
    """A valid one."""
    read: Callable[[Path], Any]
    """Reads it, and returns what was found."""
    edits: Mapping[str, Edit]
    """How it is broken."""
    write: Callable[[Path, bytes], object] = Path.write_bytes
    """Makes a file of its text."""
    places: Mapping[str, Callable[[Path], object]]
    """What can lie in the place of such a file."""


def nothing(_path: Path) -> None:
    """Leave no file at all."""


PLACES: dict[str, Callable[[Path], object]] = {"no file": nothing, "a folder": Path.mkdir}


def plan_with_stage(path: Path) -> Any:
    found = read_plan(path)
    return plan_stage(found, path.parent)


def notes_of_model(path: Path) -> Any:
    return read_model_file(path).notes


def stream(path: Path, text: bytes, *, version: int = 2) -> None:
    """Write a stream of one channel without samples, with what is said of its run."""
    head = b'{"channels": [["x", "m"]], "sample_rate_hz": 1000.0, "run": ' + text + b"}"
    covered = struct.pack("<8sII", b"\x8eFXSTRM\n", version, len(head)) + head
    path.write_bytes(covered + struct.pack("<I", zlib.crc32(covered)))


def recording(path: Path, text: bytes) -> None:
    """Write the HDF5 file of a run of one channel, with what is said of it."""
    import h5py

    with h5py.File(path, "w") as file:
        file.attrs["sample_rate_hz"] = 1000.0
        file.attrs["ending"] = "complete"
        file["run"] = text
        column = file.create_dataset("x", data=[0.0, 1.0])
        column.attrs["name"], column.attrs["unit"] = "x", "m"


def headless(path: Path) -> None:
    import h5py

    recording(path, run_metadata.TEXT.encode())
    with h5py.File(path, "a") as file:
        del file["run"]


def nameless(path: Path) -> None:
    import h5py

    recording(path, run_metadata.TEXT.encode())
    with h5py.File(path, "a") as file:
        del file["x"].attrs["name"]


def halved(path: Path) -> None:
    recording(path, run_metadata.TEXT.encode())
    path.write_bytes(path.read_bytes()[:1000])


def kinds() -> dict[str, Kind]:
    """Return the kinds of files by name."""
    # a text of HDF5 has no zero in it
    texts = {k: v for k, v in ANY_JSON.items() if k not in ("a zero", "UTF-16")}
    return {
        "stage": Kind(
            file="stage.yaml", text=stage.TEXT, read=find_stage, places=PLACES,
            edits={**ANY_YAML, **stage.EDITS},
        ),
        "stage-parameters": Kind(
            file="stage.yaml", text=stage_parameters.TEXT, read=find_stage, places={},
            edits=stage_parameters.EDITS,
        ),
        "design": Kind(
            file="stage.yaml", text=design.TEXT, read=find_stage, places=PLACES,
            edits={**ANY_YAML, **design.EDITS},
        ),
        "hysteresis-model": Kind(
            file="model.yaml", text=hysteresis_model.TEXT, read=notes_of_model, places=PLACES,
            edits={**ANY_YAML, **hysteresis_model.EDITS},
        ),
        "plan": Kind(
            file="plan.yaml", text=plan.TEXT, read=plan_with_stage, places=PLACES,
            edits={**ANY_YAML, **plan.EDITS},
        ),
        "campaign": Kind(
            file="campaign.yaml", text=campaign.TEXT, read=read_campaign, places=PLACES,
            edits={**ANY_YAML, **campaign.EDITS},
        ),
        "budget": Kind(
            file="budget.yaml", text=budget.TEXT, read=read_budget, places=PLACES,
            edits={**ANY_YAML, **budget.EDITS},
        ),
        "table": Kind(
            file="table.yaml", text=table.TEXT, read=read_table, places=PLACES,
            edits={**ANY_YAML, **table.EDITS},
        ),
        "recording": Kind(
            file="run.h5", text=run_metadata.TEXT, read=file_summary, write=recording,
            edits={**texts, **run_metadata.EDITS},
            places={
                **PLACES,
                "an empty file": lambda path: path.write_bytes(b""),
                "a text file": lambda path: path.write_bytes(b"hello\n"),
                "the first kilobyte": halved,
                "nothing said of its run": headless,
                "a channel without a name": nameless,
            },
        ),
        "stream": Kind(
            file="run.stream", text=run_metadata.TEXT, read=examine, write=stream,
            edits=ANY_JSON,
            places={
                **PLACES,
                "an empty file": lambda path: path.write_bytes(b""),
                "a text file": lambda path: path.write_bytes(b"hello\n"),
                "a version to come": lambda p: stream(p, run_metadata.TEXT.encode(), version=3),
            },
        ),
        "plan-state": Kind(
            file="run.json", text=plan_state.TEXT, read=lambda path: read_state(path.parent),
            edits={**ANY_JSON, **plan_state.EDITS}, places=PLACES,
        ),
    }  # fmt: skip


def broken(text: str, edit: Edit) -> bytes:
    """Break a valid text."""
    if isinstance(edit, tuple):
        old, new = edit
        assert text.count(old) == 1, f"{old!r} stands {text.count(old)} times"
        edit = text.replace(old, new)
    if callable(edit):
        edit = edit(text)
    return edit.encode() if isinstance(edit, str) else edit


def sentences(kind: Kind) -> Iterator[tuple[str, str]]:
    """Return what is said of each broken file of a kind, after the valid one."""
    makers = {SOUND: lambda path: kind.write(path, kind.text.encode())}
    for name, edit in kind.edits.items():
        assert name not in kind.places, name
        makers[name] = lambda path, edit=edit: kind.write(path, broken(kind.text, edit))
    for name, make in {**makers, **kind.places}.items():
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / kind.file
            make(path)
            yield name, said(kind, path)


def said(kind: Kind, path: Path) -> str:
    """Return what the command line would print of a file, after the name of the error."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            found = kind.read(path)
        except FlexstageError as error:
            sentence = f"{type(error).__name__}: {error}"
        except Exception as error:  # noqa: BLE001  # that none comes is what is asked
            sentence = f"{CRASH} {type(error).__name__}: {error}"
        else:
            notes = found if isinstance(found, tuple) else ()
            sentence = ": ".join([READ, "; ".join(notes)] if notes else [READ])
    sentence = " ".join(sentence.split()).replace(str(path.parent), HERE)
    for pattern, word in VOLATILE.items():
        sentence = re.sub(pattern, word, sentence)
    return "".join(c if c.isprintable() else f"\\x{ord(c):02x}" for c in sentence)


def frozen(name: str) -> dict[str, str]:
    """Return what was said of each broken file of a kind when it was frozen."""
    blocks = (FOLDER / f"{name}.txt").read_text("utf-8").strip().split("\n\n")
    return dict(block.split("\n  ") for block in blocks)


def freeze(name: str, kind: Kind) -> bool:
    """Write what is said."""
    FOLDER.mkdir(exist_ok=True)
    found = dict(sentences(kind))
    blocks = "\n".join(f"{way}\n  {sentence}\n" for way, sentence in found.items())
    (FOLDER / f"{name}.txt").write_text(blocks, "utf-8")
    print(f"{name}: {len(found)} cases kept")  # noqa: T201
    return True


def check(name: str, kind: Kind) -> bool:
    """Print what is said otherwise; whether nothing is."""
    was, now = frozen(name), dict(sentences(kind))
    ways = [way for way in {**was, **now} if was.get(way) != now.get(way)]
    print(f"{name}: {f'{len(ways)} differences' if ways else 'the same'}")  # noqa: T201
    for way in ways:
        print(f"  {way}\n    was: {was.get(way)}\n    now: {now.get(way)}")  # noqa: T201
    return not ways


def main(words: list[str]) -> int:
    """Read the kinds asked for; 0 where all is said as it was."""
    act, *rest = words
    todo = {name: kind for name, kind in kinds().items() if not rest or name in rest}
    done = [{"freeze": freeze, "check": check}[act](name, kind) for name, kind in todo.items()]
    return 0 if all(done) else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
