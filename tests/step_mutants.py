"""STEP files with one damage each, and what becomes of those who read them."""

import re
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np

from flexstage.base.errors import FlexstageError

_REFERENCE = re.compile(r"(?<=[(,])#\d+")
_NUMBER = re.compile(r"(?<=[(,])-?\d+\.\d*(?:E[+-]?\d+)?")
_KEYWORD = re.compile(r"(?<==)\s?[A-Z_0-9]+(?=\()")
_LIST = re.compile(r"\((?:#\d+,)+#\d+\)")
_HOSTILE = (
    *("1e9", "-1.", "0.", "1.E308", "-1.E-308", "1.E17", "NAN", "$", "*", "#0", "#99999999"),
    *("''", "'\\X\\C4'", ".T.", "()", "(#1,#1)", "1.E-7", "2147483648", "-5"),
)


def mutant(text: str, seed: int) -> tuple[str, str]:
    """Return the kind of a damage, and a STEP file that has it."""
    rng = np.random.default_rng(seed)
    kinds = tuple(_DAMAGES)
    kind = kinds[int(rng.integers(len(kinds)))]
    head, data = text.split("DATA;", 1)
    # an instance a line
    data = re.sub(r";\s*", ";\n", re.sub(r"\s*([=(),])\s*", r"\1", data))
    return kind, f"{head}DATA;{_DAMAGES[kind](data, rng)}"


def _one(data: str, pattern: re.Pattern[str], rng: np.random.Generator, new: str) -> str:
    found = list(pattern.finditer(data))
    chosen = found[int(rng.integers(len(found)))]
    return data[: chosen.start()] + new + data[chosen.end() :]


def _pick(rng: np.random.Generator, words: list[str] | tuple[str, ...]) -> str:
    return words[int(rng.integers(len(words)))]


def _lines(data: str) -> list[str]:
    """Return the instances of a file, each of which begins with its number."""
    return re.split(r"\n(?=#\d+\s?=)", data)


def _line_lost(data: str, rng: np.random.Generator) -> str:
    lines = _lines(data)
    del lines[int(rng.integers(1, len(lines) - 1))]
    return "\n".join(lines)


def _lines_swapped(data: str, rng: np.random.Generator) -> str:
    """Give the contents of two instances to each other."""
    lines = _lines(data)
    a, b = (int(k) for k in rng.integers(1, len(lines) - 1, 2))
    (m, x), (n, y) = (lines[k].split("=", 1) for k in (a, b))
    lines[a], lines[b] = f"{m}={y}", f"{n}={x}"
    return "\n".join(lines)


def _list_cut(data: str, rng: np.random.Generator) -> str:
    found = list(_LIST.finditer(data))
    chosen = found[int(rng.integers(len(found)))]
    parts = chosen[0][1:-1].split(",")
    del parts[int(rng.integers(len(parts)))]
    return data[: chosen.start()] + f"({','.join(parts)})" + data[chosen.end() :]


def _argument_lost(data: str, rng: np.random.Generator) -> str:
    found = [m.start() for m in re.finditer(r",(?=[#\d.$*'-])", data)]
    at = found[int(rng.integers(len(found)))]
    return data[:at] + re.sub(r"^,[^,()]*", "", data[at:], count=1)


def _byte_changed(data: str, rng: np.random.Generator) -> str:
    at = int(rng.integers(1, len(data) - 64))
    return data[:at] + chr(int(rng.integers(33, 127))) + data[at + 1 :]


_DAMAGES: dict[str, Callable[[str, np.random.Generator], str]] = {
    "a reference to another instance": lambda data, rng: _one(
        data, _REFERENCE, rng, _pick(rng, re.findall(r"^#\d+", data, re.MULTILINE))
    ),
    "a reference that is none": lambda data, rng: _one(data, _REFERENCE, rng, _pick(rng, _HOSTILE)),
    "another number": lambda data, rng: _one(data, _NUMBER, rng, _pick(rng, _HOSTILE)),
    "another kind of instance": lambda data, rng: _one(
        data, _KEYWORD, rng, _pick(rng, _KEYWORD.findall(data))
    ),
    "an instance lost": _line_lost,
    "two instances exchanged": _lines_swapped,
    "an element of a list lost": _list_cut,
    "an argument lost": _argument_lost,
    "a byte changed": _byte_changed,
}


def read_mutants(source: Path, folder: Path, seeds: range) -> list[str]:
    """Read damaged copies of a file as a part and as a plate; say what became of each.

    A line for each reading: seed, route, kind of damage, ``read`` or ``refused`` and the reason.
    """
    lines = []
    for seed in seeds:
        kind, text = mutant(source.read_text("latin-1"), seed)
        path = folder / f"{source.stem}-{seed}.step"
        path.write_text(text, "latin-1")
        for route, read in _ROUTES.items():
            said = "read"
            try:
                read(path)
            except FlexstageError as error:
                said = f"refused: {error}"
            lines.append(f"{seed}, {route}, {kind}: {said}")
        path.unlink()
    return lines


def _as_part(path: Path) -> None:
    from flexstage.fem.part import part_surface, read_step

    part_surface(read_step(path, solid="all"))


def _as_plate(path: Path) -> None:
    from flexstage.stage.drawing.drawn_stage import read_drawing

    read_drawing(path)


_ROUTES: dict[str, Callable[[Path], None]] = {"part": _as_part, "plate": _as_plate}


def _main(source: str, folder: str, first: str, stop: str, step: str = "1") -> None:
    for seed in range(int(first), int(stop), int(step)):
        for line in read_mutants(Path(source), Path(folder), range(seed, seed + 1)):
            sys.stdout.write(f"{line}\n")
            sys.stdout.flush()


if __name__ == "__main__":
    _main(*sys.argv[1:])
