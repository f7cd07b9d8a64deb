"""Builds exported Simulink models in Octave, with stand-ins that record and check every call."""

import subprocess
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.io import loadmat, savemat

from flexstage.export.diagram.graph import Block, Diagram, SignalLine
from tests.octave_program import run_octave

STAND_INS = Path(__file__).parent / "octave"
_CHAINS = {"hysteresis": "hysteresis", "voltage": "amplifier", "lags": "creep"}


@dataclass(frozen=True, kw_only=True)
class Recorded:
    """A block as it was built: what feeds each of its inputs, and its evaluated parameters."""

    path: str
    type: str
    parameters: dict[str, Any]
    values: dict[str, np.ndarray]
    sources: tuple[str, ...]


@dataclass(frozen=True, kw_only=True)
class Recording:
    """A model as it was built."""

    blocks: dict[str, Recorded]
    all_blocks: dict[str, Recorded]
    signals: set[str]
    settings: dict[str, str]

    def below(self, system: str) -> Iterator[Recorded]:
        """The blocks of a system and of those inside."""
        return (b for b in self.blocks.values() if b.path.startswith(f"{system}/"))


def octave(folder: Path, code: str, **given: np.ndarray) -> subprocess.CompletedProcess[str]:
    """Run Octave in a folder, with the stand-ins and what is given; `out` is saved as out.mat."""
    savemat(folder / "given.mat", given)
    return run_octave(folder, f"addpath('{STAND_INS}');\naddpath(pwd);\nload('given.mat');\n{code}")


def write(folder: Path, files: Mapping[str, bytes]) -> None:
    """Write files into a folder."""
    for name, content in files.items():
        (folder / name).write_bytes(content)


def build(
    folder: Path, files: Mapping[str, bytes], name: str, *, stop: float = 0.0, parts: int = 0
) -> tuple[Recording, dict[str, np.ndarray]]:
    """Build a model, and run it up to a time; readings by variable, and ``t``."""
    write(folder, files)
    (folder / "functions").mkdir()
    run = (
        f"[t, y, names] = simulink_run(simulink_compile(), {stop!r}, {parts}, "
        "fullfile(pwd, 'functions')); save('-v7', 'run.mat', 't', 'y', 'names');"
        if stop > 0.0
        else ""
    )
    done = octave(folder, f"{name}_build();\nsimulink_record('recorded.mat');\n{run}")
    assert done.returncode == 0, done.stderr[-3000:]
    assert done.stderr == "", done.stderr
    found: dict[str, np.ndarray] = {}
    if stop > 0.0:
        ran = loadmat(folder / "run.mat")
        names = [str(n[0]) for n in ran["names"].ravel()]
        found = {"t": ran["t"].ravel(), **dict(zip(names, ran["y"].T, strict=True))}
    return recording(folder / "recorded.mat"), found


def recording(file: Path) -> Recording:
    """Read what was recorded."""
    made = loadmat(file, struct_as_record=False)
    flat = [c[0, 0] for c in made["blocks"].ravel()]
    paths = [_text(b.path) for b in flat]
    blocks = {
        path: Recorded(
            path=path,
            type=_text(b.type),
            parameters=_parameters(b.parameters),
            # matrices as they are: a column stays a column
            values=_fields(b.values),
            sources=tuple(paths[int(i) - 1] for i in b.sources.ravel()),
        )
        for path, b in zip(paths, flat, strict=True)
    }
    every = [c[0, 0] for c in made["all_blocks"].ravel()]
    return Recording(
        blocks=blocks,
        all_blocks={
            _text(b.path): Recorded(
                path=_text(b.path), type=_text(b.type), parameters=_parameters(b.parameters),
                values={}, sources=(),
            )
            for b in every
        },
        signals={_text(c[0, 0].name) for c in made["lines"].ravel()} - {""},
        settings={k: _text(v) for k, v in _fields(made["settings"]).items()},
    )  # fmt: skip


def _text(value: np.ndarray) -> str:
    return str(value.item()) if value.size else ""


def _parameters(given: np.ndarray) -> dict[str, Any]:
    fields = _fields(given)
    return {k: v.ravel() if k == "Position" else _text(v) for k, v in fields.items()}


def _fields(given: np.ndarray) -> dict[str, np.ndarray]:
    made = given[0, 0]
    return {name: getattr(made, name) for name in getattr(made, "_fieldnames", [])}


def rebuilt(made: Recording, name: str, like: Diagram) -> Diagram:
    """Make a diagram of the recorded blocks and lines alone; models of chains, which have no
    counterpart among blocks, are taken from another diagram."""
    root = f"{name}/structure"
    chains = _chains(made, root, {g.name for g in like.groups})
    blocks: dict[str, Block] = {}
    feeds: dict[tuple[str, int], str] = {}

    def owner(path: str) -> str:
        for system in chains:
            if path.startswith(f"{system}/"):
                return system.rsplit("/", 1)[1]
        return path.rsplit("/", 1)[1].removeprefix("command_")

    for system, kind in chains.items():
        short = system.rsplit("/", 1)[1]
        blocks[short] = _block(short, kind, system, root, model=like.block(short).model)
    for b in made.below(root):
        short = owner(b.path)
        for port, source in enumerate(b.sources):
            if short in blocks and blocks[short].model is not None:
                if owner(source) != short:
                    feeds[short, 0] = owner(source)
            else:
                feeds[short, port] = owner(source)
        if short not in blocks:
            blocks[short] = _plain(b, short, root)
    for b in made.blocks.values():
        if b.type == "FromWorkspace":
            short = owner(b.path)
            blocks[short] = Block(name=short, kind="input", label="", meaning="")
        if b.type == "ToWorkspace" and b.sources[0].startswith(root):
            short = b.path.rsplit("/", 1)[1].removeprefix(f"keep_{name}_")
            blocks[short] = Block(name=short, kind="output", label="", meaning="")
            feeds[short, 0] = owner(b.sources[0])
    lines = tuple(SignalLine(source=s, target=t, port=p) for (t, p), s in feeds.items())
    return Diagram(
        title="", blocks=_wide(blocks, feeds), lines=lines, groups=like.groups,
    )  # fmt: skip


def _chains(made: Recording, root: str, groups: set[str]) -> dict[str, str]:
    found: dict[str, str] = {}
    for b in made.all_blocks.values():
        if b.type == "SubSystem" and b.path.startswith(f"{root}/"):
            last = b.path.rsplit("/", 1)[1]
            if last not in groups:
                inner = {x.path.rsplit("/", 1)[1] for x in made.below(b.path)}
                kinds = [kind for mark, kind in _CHAINS.items() if mark in inner]
                found[b.path] = kinds[0] if kinds else "sensor"
    return found


def _group(path: str, root: str) -> str:
    parts = path.removeprefix(f"{root}/").split("/")
    return parts[0] if len(parts) > 1 else ""


def _block(name: str, kind: Any, path: str, root: str, **more: Any) -> Block:
    return Block(
        name=name, kind=kind, label="", meaning="", group=_group(path, root), **more
    )  # fmt: skip


def _plain(b: Recorded, name: str, root: str) -> Block:
    if b.type == "Gain" and b.parameters["Multiplication"].startswith("Matrix"):
        matrix = b.values["Gain"]
        return _block(name, "gain", b.path, root, width=matrix.shape[0], matrix=matrix)
    if b.type == "Gain":
        return _block(name, "sum", b.path, root, width=0, signs=(int(b.values["Gain"].item()),))
    if b.type == "Constant":
        return _block(name, "sum", b.path, root, width=b.values["Value"].size)
    if b.type == "Integrator":
        start = b.values["InitialCondition"]
        assert np.array_equal(start, np.zeros_like(start))
        return _block(name, "integrator", b.path, root, width=start.size)
    assert b.type == "Sum", b.type
    signs = tuple(1 if c == "+" else -1 for c in b.parameters["Inputs"])
    return _block(name, "sum", b.path, root, width=0, signs=signs)


def _wide(blocks: dict[str, Block], feeds: dict[tuple[str, int], str]) -> tuple[Block, ...]:
    """Give sums and outputs the width of what feeds them."""
    from dataclasses import replace

    def width(name: str, seen: frozenset[str] = frozenset()) -> int:
        b = blocks[name]
        if b.kind not in ("sum", "output") or (b.kind == "sum" and b.width > 0) or name in seen:
            return b.width
        ports = len(b.signs) if b.kind == "sum" else 1
        return max(width(feeds[name, p], seen | {name}) for p in range(ports))

    return tuple(replace(b, width=width(b.name)) for b in blocks.values())
