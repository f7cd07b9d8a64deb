"""CalculiX (G. Dhondt, The Finite Element Method for Three-Dimensional Thermomechanical
Applications, 2004) as a peer: a deck from plain arrays, a run of `ccx`, its answers as arrays.

Everything here is SI; the deck is in millimetres, newtons, megapascals and tonnes.
"""

import os
import shutil
import subprocess
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from flexstage.base.arrays import Array
from flexstage.quantities.material import Material
from tests.peers.grids import Grid

Index = NDArray[np.intp]

#: What `ccx` may take at most [s].
LIMIT = 1800.0
# Plane elements are three-dimensional inside, and those of plane stress lock where they are thick
# against their size: a thin part under a load as much smaller has the same displacements.
_THIN = 0.01e-3

KINDS = {6: ("CPS6", "CPE6"), 8: ("CPS8", "CPE8"), 15: ("C3D15",), 20: ("C3D20", "C3D20R")}


@dataclass(frozen=True, slots=True, kw_only=True)
class Job:
    """What CalculiX is asked: statics of each load, then natural frequencies."""

    grid: Grid
    kind: str
    material: Material
    thickness: float | None = None  # of a plane part [m]
    held: Mapping[str, Index] = field(default_factory=dict)  # nodes by directions, as "xy" or "z"
    # materials of regions by name, and the direction of their fibres, which alone are stiff
    others: Mapping[str, tuple[Material, str]] = field(default_factory=dict)
    base: float | None = None  # 1 K warmer without loads: held nodes move with it
    loads: Sequence[Array] = ()  # nodal forces [N], each (n, 2 or 3)
    stress: bool = False
    printed: Index | None = None  # nodes whose stress is wanted, all where not given
    modes: int = 0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Answer:
    """What CalculiX found, one displacement (and stress) for each load."""

    displacements: list[Array]  # [m], (n, 2 or 3)
    stresses: list[Array]  # xx, yy, zz, yz, xz, xy at nodes, mean of their elements [Pa], (n, 6)
    frequencies: Array  # [Hz]
    seconds: float  # of the run of ccx alone


def needed() -> str:
    """Return the path of ccx, or skip the test that wants it."""
    path = shutil.which("ccx")
    if path is None:
        pytest.skip("CalculiX is not installed: no 'ccx' on the path (Debian: calculix-ccx)")
    return path


def solve(job: Job, *, threads: int | None = None) -> Answer:
    """Run CalculiX in a folder of its own."""
    with tempfile.TemporaryDirectory(prefix="ccx-") as name:
        seconds = _run(deck(job), Path(name), threads)
        return _answer(job, Path(name), seconds)


def _run(text: str, folder: Path, threads: int | None) -> float:
    """Run a deck in a folder; return the seconds."""
    ccx = needed()
    many = str(threads or os.cpu_count() or 1)
    (folder / "job.inp").write_text(text, encoding="ascii")
    start = time.perf_counter()
    done = subprocess.run(
        [ccx, "-i", "job"],
        cwd=folder,
        env={**os.environ, "OMP_NUM_THREADS": many, "CCX_NPROC_RESULTS": many},
        capture_output=True,
        text=True,
        timeout=LIMIT,
        check=False,
    )
    if done.returncode or "*ERROR" in done.stdout:
        raise RuntimeError(f"ccx failed ({done.returncode}): {done.stdout[-2000:]}")
    return time.perf_counter() - start


def on_a_moving_base(
    job: Job, bands: Sequence[tuple[float, float]], node: int, damping: float
) -> tuple[float, list[tuple[float, complex]]]:
    """Let the base accelerate by 1 m/s^2 along x, at both ends of bands without a mode.

    Returns the first natural frequency [Hz], and each frequency with the motion of the node along x
    in the room [m].
    """
    text = deck(job).replace("*FREQUENCY\n", "*FREQUENCY, STORAGE=YES\n")
    text = text.replace(
        "*STEP\n",
        f"*NSET, NSET=READ\n{node + 1},\n*AMPLITUDE, NAME=ONE\n0.,1000.,1.E6,1000.\n*STEP\n",
        1,
    )
    for low, high in bands:
        text += (
            f"*STEP\n*STEADY STATE DYNAMICS\n{low:.9g},{high:.9g},2,1.\n*MODAL DAMPING\n"
            f"1,{job.modes},{float(damping)!r}\n*BASE MOTION, DOF=1, AMPLITUDE=ONE\n"
            "*NODE PRINT, NSET=READ\nU\n*END STEP\n"
        )
    with tempfile.TemporaryDirectory(prefix="ccx-") as name:
        _run(text, Path(name), None)
        words = (Path(name) / "job.dat").read_text(encoding="ascii").split("for set READ and time")
        first = float(_frequencies(Path(name) / "job.dat", 1)[0])
    rows = [part.split()[:3] for part in words[1:]]
    # real and imaginary parts follow each other
    pairs = zip(rows[::2], rows[1::2], strict=True)
    return first, [
        (float(real[0]), 1e-3 * complex(float(real[2]), float(imaginary[2])))
        for real, imaginary in pairs
    ]


def deck(job: Job) -> str:
    """Write the input deck."""
    plane = job.grid.nodes.shape[1] == 2
    if plane != (job.thickness is not None):
        raise ValueError("a plane part has a thickness, and a solid none")
    if job.kind not in KINDS[job.grid.elements.shape[1]]:
        raise ValueError(f"{job.kind} has not {job.grid.elements.shape[1]} nodes")
    thin = 1e3 * (_THIN if plane else 0.0)
    scale = _THIN / job.thickness if job.thickness is not None else 1.0
    lines = ["*NODE, NSET=NALL"]
    flat = [",0." if plane else ""] * job.grid.nodes.shape[0]
    for k, (row, rest) in enumerate(zip((1e3 * job.grid.nodes).tolist(), flat, strict=True), 1):
        lines.append(f"{k}," + ",".join(f"{c:.12g}" for c in row) + rest)
    lines.append(f"*ELEMENT, TYPE={job.kind}, ELSET=EALL")
    for k, row in enumerate((job.grid.elements + 1).tolist(), 1):
        # a line holds sixteen numbers
        numbers = [str(k), *map(str, row)]
        lines.append(",".join(numbers[:11]) + ("," if len(numbers) > 11 else ""))
        if len(numbers) > 11:
            lines.append(",".join(numbers[11:]))
    rest = np.arange(job.grid.elements.shape[0])
    for region in job.others:
        rest = rest[[job.grid.regions[k] != region for k in rest]]
    sections = [(job.material, "", rest)] + [
        (material, fibres, np.flatnonzero([r == region for r in job.grid.regions]))
        for region, (material, fibres) in job.others.items()
    ]
    for number, (material, fibres, own) in enumerate(sections):
        lines += [f"*ELSET, ELSET=E{number}", *(f"{k + 1}," for k in own.tolist())]
        lines += [f"*MATERIAL, NAME=M{number}", *_elastic(material, fibres)]
        if job.base is not None:
            lines += ["*EXPANSION, ZERO=0.", f"{material.thermal_expansion!r}"]
        lines.append(f"*SOLID SECTION, ELSET=E{number}, MATERIAL=M{number}")
        if plane:
            lines.append(f"{thin!r}")
    for number, (directions, nodes) in enumerate(job.held.items()):
        lines.append(f"*NSET, NSET=H{number}")
        lines += [f"{n + 1}," for n in nodes.tolist()]
        lines.append("*BOUNDARY")
        lines += [f"H{number},{'xyz'.index(c) + 1},{'xyz'.index(c) + 1}" for c in directions]
    if job.printed is not None:
        lines += ["*NSET, NSET=PRINTED", *(f"{n + 1}," for n in job.printed.tolist())]
    if job.base is not None:
        lines += ["*INITIAL CONDITIONS, TYPE=TEMPERATURE", "NALL,0."]
        lines += ["*STEP", "*STATIC", "*TEMPERATURE", "NALL,1.", "*BOUNDARY"]
        for directions, nodes in job.held.items():
            for n in nodes.tolist():
                for c in map("xyz".index, directions):
                    moved = job.base * 1e3 * job.grid.nodes[n, c]
                    lines.append(f"{n + 1},{c + 1},{c + 1},{moved:.14g}")
        lines += [f"*NODE FILE{', OUTPUT=2D' if plane else ''}", "U", "*END STEP"]
    for load in job.loads:
        lines += ["*STEP", "*STATIC", "*CLOAD, OP=NEW"]
        for n, c in zip(*np.nonzero(load), strict=True):
            lines.append(f"{n + 1},{c + 1},{scale * load[n, c]:.14g}")
        output = ", OUTPUT=2D" if plane else ""
        lines += [f"*NODE FILE{output}", "U"]
        if job.stress:
            lines += [f"*EL FILE{output}{', NSET=PRINTED' * (job.printed is not None)}", "S"]
        lines.append("*END STEP")
    if job.modes:
        lines += ["*STEP", "*FREQUENCY", str(job.modes)]
        if job.loads:
            # what the steps before print holds until another is asked for
            least = ", NSET=PRINTED" if job.printed is not None else ""
            lines += ["*CLOAD, OP=NEW", f"*NODE FILE{least}", "U"]
        lines.append("*END STEP")
    return "\n".join(lines) + "\n"


def _elastic(material: Material, fibres: str) -> list[str]:
    """Write elasticity and density of a material, of fibres along x or y if these are named."""
    modulus = material.youngs_modulus * 1e-6
    lines = ["*ELASTIC", f"{modulus!r},{material.poissons_ratio!r}"]
    if fibres:
        moduli = [modulus if axis == fibres else 1e-3 * modulus for axis in "xyz"]
        shear = 3e-4 * modulus
        lines = ["*ELASTIC, TYPE=ENGINEERING CONSTANTS"]
        lines += [f"{','.join(map(repr, moduli))},0.,0.,0.,{shear!r},{shear!r}", f"{shear!r},0."]
    return [*lines, "*DENSITY", f"{material.density * 1e-12!r}"]


def _answer(job: Job, folder: Path, seconds: float) -> Answer:
    count, dimension = job.grid.nodes.shape
    blocks = _blocks(folder / "job.frd", count)
    displacements = [b[:, :dimension] * 1e-3 for name, b in blocks if name == "DISP"]
    # the file has xx, yy, zz, xy, yz, zx
    stresses = [b[:, [0, 1, 2, 4, 5, 3]] * 1e6 for name, b in blocks if name == "STRESS"]
    return Answer(
        displacements=displacements[: len(job.loads) + (job.base is not None)],
        stresses=stresses[: len(job.loads)] if job.stress else [],
        frequencies=_frequencies(folder / "job.dat", job.modes),
        seconds=seconds,
    )


def _blocks(path: Path, count: int) -> list[tuple[str, Array]]:
    """Read the results at nodes of a .frd file: its name and an array for each block."""
    found: list[tuple[str, Array]] = []
    values: Array | None = None
    with path.open(encoding="ascii") as file:
        for text in file:
            mark = text[:3]
            if mark == " -1" and values is not None:
                row = int(text[3:13]) - 1
                body = text[13:].rstrip()
                numbers = [float(body[k : k + 12]) for k in range(0, len(body), 12)]
                if row < count:
                    values[row, : len(numbers)] = numbers
            elif mark == " -4":
                values = np.zeros((count, 6))
                found.append((text.split()[1], values))
            elif mark == " -3":
                values = None
    return found


def _frequencies(path: Path, count: int) -> Array:
    """Read the natural frequencies of a .dat file [Hz]."""
    if not count:
        return np.empty(0)
    found: list[float] = []
    inside = False
    for text in path.read_text(encoding="ascii").splitlines():
        words = text.split()
        if "E I G E N V A L U E" in text:
            inside = True
        elif inside and len(words) == 5 and words[0].isdigit():
            found.append(float(words[3]))
        elif inside and found:
            break
    return np.array(found)
