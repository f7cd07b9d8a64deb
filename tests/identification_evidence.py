"""What faults in a record do to an identification, and what is said of them.

Faults are put into a measured record (PICMA P-885.91 of ``../shared/data``) and into one of a
simulated stack, driven as ``flexstage excite`` designs it. Each record is identified by the command
line, and the model that comes out is tried on the record without the fault as well. Run as a
program for a table of one of the two, by this or another source of flexstage, of all faults or of
those whose names hold one of some words:
``python tests/identification_evidence.py picma [SOURCE [WORD...]]``.
"""

import json
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.ndimage import gaussian_filter1d

from flexstage.base.arrays import Array
from flexstage.hysteresis import LogCreep, Sensor, excitation
from flexstage.records import read_record
from flexstage.virtual import virtual_stack

HERE = Path(__file__).resolve().parents[1]
PICMA = HERE.parent / "shared" / "data" / "picma-p885" / "Test_Vi_Do_Di.dat"
#: Rate that loggers of a computer reach, and how far their times are off.
LOGGED_HZ, JITTER = 10.4, 0.2
#: A model is tried on what follows this share of a record, where its memory is wiped out.
BEGUN = 0.15
#: A figure, held out or on the record without the fault, that is worse by this factor needs a
#: sentence.
ALLOWED = 1.5
#: What another source of the program cannot compute itself: a model on a record as it stands.
TRY = """
import json, sys
from pathlib import Path
import numpy as np
from flexstage.hysteresis import read_model_text
file, clean, dt, begun, scale = sys.argv[1:]
u, y = np.load(clean)
model = read_model_text(Path(file).read_text(encoding="utf-8")).model
e = (float(scale) * model.simulate(u, float(dt)) - y)[int(float(begun) * u.size) :]
print(json.dumps([100.0 / float(np.ptp(y)) * float(v) for v in (np.mean(e**2) ** 0.5, np.std(e))]))
"""


@dataclass(frozen=True, kw_only=True)
class Bench:
    """A drive, and a record of it without a fault."""

    u: Array
    y: Array
    rate_hz: float
    #: Whether it is simulated, and can be driven otherwise.
    stack: bool = False

    def driven(self, u: Array) -> Array | None:
        """What the output does for another command; None where it was measured."""
        return measured_by(u, 1.0 / self.rate_hz) if self.stack else None


@dataclass(frozen=True, kw_only=True)
class Fault:
    """A record with a fault, written as a file, and how it is read."""

    name: str
    u: Array
    y: Array
    rate_hz: float
    time: Array | None = None
    options: tuple[str, ...] = ()
    unit: str = "um"
    model: str = "preisach"
    told_rate_hz: float = 0.0
    #: Samples of the record without a fault to one of this.
    every: int = 1


def measured_by(u: Array, dt: float) -> Array:
    """Drive a simulated stack with creep and a sensor [um]."""
    free = virtual_stack((0.0, 120.0), 38e-6, 0.13).simulate(u).values
    moved = LogCreep(rate_per_decade=0.015).simulate(free, dt).values
    sensor = Sensor(bandwidth_hz=100.0, noise_rms=8e-9, offset=3.1e-6, seed=4)
    return 1e6 * sensor.simulate(moved, dt).values


def picma() -> Bench:
    """Return the measured record [V, um]."""
    read = read_record(PICMA, sample_rate=200.0)
    return Bench(u=read.channel("0").values, y=read.channel("4").values, rate_hz=200.0)


def stack() -> Bench:
    """Return the simulated record [V, um], at two rates."""
    rate = 500.0
    made = excitation(
        (0.0, 120.0), sample_rate=rate, duration=25.0, rates=(0.5, 5.0),
        frequency=240.0, multisine=False,
    )  # fmt: skip
    u = made.voltage
    return Bench(u=u, y=measured_by(u, 1.0 / rate), rate_hz=rate, stack=True)


def faults(own: Bench) -> Iterator[Fault]:
    """Yield the record with each of the faults."""
    u, y, rate = own.u, own.y, own.rate_hz
    rng = np.random.default_rng(15)
    swing, stroke = float(np.ptp(u)), float(np.ptp(y))
    noise = 1.4826 * float(np.median(np.abs(np.diff(y, 3)))) / np.sqrt(20.0)

    def record(name: str, u: Array, y: Array, **other: Any) -> Fault:
        return Fault(name=name, u=u, y=y, rate_hz=rate, **other)

    yield record("none", u, y)
    yield record("none, auto", u, y, model="auto")
    for idle in (5.0, 20.0, 60.0):
        n = int(idle * rate)
        rest = y[0] + noise * rng.standard_normal(n)
        yield record(f"idle for {idle:g} s", np.r_[np.full(n, u[0]), u], np.r_[rest, y])
    rest = y[0] + noise * rng.standard_normal(int(20.0 * rate))
    yield record(
        "idle for 20 s, auto", np.r_[np.full(rest.size, u[0]), u], np.r_[rest, y], model="auto"
    )
    for n in (2, 10, 20, 50):
        held = u[np.arange(u.size) // n * n]
        moved = own.driven(held)
        yield record(f"command held {n} samples", held, y if moved is None else moved)
    for percent in (0.1, 0.3, 1.0):
        noisy = u + 0.01 * percent * swing * rng.standard_normal(u.size)
        yield record(f"input noise {percent:g} %", noisy, y)
    for speed in (0.05, 0.2):
        yield record(f"drift {speed:g} um/s", u, y + speed * np.arange(u.size) / rate)
    for percent in (2.0, 5.0, 20.0):
        jump = 0.01 * percent * stroke * (np.arange(u.size) >= u.size // 2)
        yield record(f"jump of {percent:g} %", u, y + jump)
    jump = 0.05 * stroke * (np.arange(u.size) >= u.size // 2)
    yield record("jump of 5 %, auto", u, y + jump, model="auto")
    yield record("clipped at 87 %", u, np.minimum(y, y.min() + 0.87 * stroke))
    yield record("clipped, 1 % of samples", u, np.minimum(y, np.quantile(y, 0.99)))
    for share, noise in ((0.95, 0.01), (0.9, 0.02)):
        stopped = np.minimum(y, y.min() + share * stroke) + noise * stroke * rng.normal(size=u.size)
        yield record(f"clipped at {100 * share:g} %, noise {100 * noise:g} %", u, stopped)
    above = (y - y.min()) / stroke
    yield record("saturated", u, stroke * np.tanh(2.0 * above))
    yield record("partial butterfly", u, stroke * np.abs(above - 0.2))
    yield record("steps of 2 %", u, np.round(y / (0.02 * stroke)) * 0.02 * stroke)
    late = round(rate)
    yield record("output 1 s early", u[:-late], y[late:])
    yield record("output 1 s late", u[late:], y[:-late])
    yield record("gain +5 % at half", u, y * np.where(np.arange(u.size) < u.size // 2, 1.0, 1.05))
    yield record("own reading as input", y - y.min(), y)
    yield record("swapped columns", y, u)
    wander = low_passed(rng.standard_normal(u.size), rate)
    wander = u.min() + swing * (0.5 + 0.5 * np.tanh(wander))
    moved = own.driven(wander)
    if moved is not None:
        yield record("random walk, swapped columns", moved, wander)
    spiked = y.copy()
    spiked[rng.choice(u.size, 4, replace=False)] += 0.5 * stroke * np.array([1.0, -1.0, 1.0, -1.0])
    yield record("4 spikes", u, spiked)
    at = np.arange(u.size) / rate
    for told in (rate, LOGGED_HZ):
        every = 1 if told == rate else 4  # a logger is slow, and so is what it logs
        late = at[::every] + JITTER * every / rate * rng.uniform(-1.0, 1.0, at[::every].size)
        late = np.sort(np.clip(late, at[0], at[-1]))
        own_u, own_y = (np.interp(late, at, v) for v in (u, y))
        yield record(
            f"times +-{100 * JITTER:g} %, {told:g} Hz", own_u, own_y,
            time=late * rate / told / every, every=every,
            options=("--resample", "median"), told_rate_hz=told,
        )  # fmt: skip
    yield record("rate ten times too high", u, y, told_rate_hz=10.0 * rate)
    described = ("--stage", "vgtu-piezo", "--axis", "x")
    yield record("mV for V", 1e-3 * u, y)
    yield record("mm for um", u, y, unit="mm")
    yield record("mm for um, --stage", u, y, unit="mm", options=described)


def low_passed(values: Array, rate_hz: float) -> Array:
    """Motion of about 0.3 and 2 Hz, of rms 1.2."""
    parts = [gaussian_filter1d(values, rate_hz * width) for width in (0.08, 0.5)]
    mixed = parts[0] / parts[0].std() + parts[1] / parts[1].std()
    return 1.2 * mixed / mixed.std()


def identified(fault: Fault, own: Bench, source: Path, folder: Path) -> dict[str, Any]:
    """Identify a record by the command line of a source, and try the model without the fault."""
    file, out = folder / "record.csv", folder / "model.yaml"
    out.unlink(missing_ok=True)
    told = fault.told_rate_hz or fault.rate_hz
    time = np.arange(fault.u.size) / told if fault.time is None else fault.time
    if fault.time is None:
        np.savetxt(
            file, np.column_stack((fault.u, fault.y)), delimiter=",", header="u,y", comments=""
        )
    else:
        table = np.column_stack((time, fault.u, fault.y))
        np.savetxt(file, table, delimiter=",", header="time (s),u,y", comments="")
    rate = () if fault.time is not None else ("--sample-rate", repr(told))
    command = [
        sys.executable, "-m", "flexstage", "identify", str(file), "--input", "u V",
        "--output", f"y {fault.unit}", "--model", fault.model, *rate,
        *fault.options, "--out", str(out), "--json",
    ]  # fmt: skip
    where = {**os.environ, "PYTHONPATH": str(source), "COLUMNS": "1000"}
    run = subprocess.run(command, capture_output=True, text=True, env=where, check=False)
    if run.returncode != 0:
        return {"refused": " ".join(run.stderr.split())}
    found: dict[str, Any] = json.loads(run.stdout)
    np.save(folder / "clean.npy", np.stack((own.u, own.y)))
    dt = 1.0 / (told * fault.every)
    turned = {"um": 1e6, "mm": 1e3}[fault.unit]
    words = [str(out), str(folder / "clean.npy"), repr(dt), repr(BEGUN), repr(turned)]
    tried = subprocess.run(
        [sys.executable, "-c", TRY, *words], capture_output=True, text=True, env=where, check=False
    )
    found["clean"] = json.loads(tried.stdout) if tried.returncode == 0 else [np.nan, np.nan]
    return found


def main() -> None:
    """Write a row for every fault."""
    own = {"picma": picma, "stack": stack}[sys.argv[1]]()
    source = Path(sys.argv[2]) if len(sys.argv) > 2 else HERE / "src"
    words = sys.argv[3:] or [""]
    clean: dict[str, tuple[float, float, set[str]]] = {}
    with tempfile.TemporaryDirectory() as name:
        for fault in faults(own):
            if fault.name != "none" and not any(word in fault.name for word in words):
                continue
            found = identified(fault, own, source, Path(name))
            sys.stdout.write(row(fault, found, clean) + "\n")
            sys.stdout.flush()


def row(
    fault: Fault, found: dict[str, Any], clean: dict[str, tuple[float, float, set[str]]]
) -> str:
    """Return a row of the table; the first one of a model is what the others are judged by."""
    if "refused" in found:
        return f"| {fault.name} | refused | | | | | {found['refused']} |"
    said = [str(s) for s in (*found["warnings"], *found.get("notes", ()))]
    held = float(found["heldout_rms_percent"])
    free = found.get("heldout_free_constant_rms_percent")
    tried, tried_free = found["clean"]
    begins = {beginning(s) for s in said}
    best, right, usual = clean.setdefault(fault.model, (held, tried, begins))
    new = [s for s in said if beginning(s) not in usual]
    worse = held > ALLOWED * best or not tried <= ALLOWED * right
    silent = " **silent**" if worse and not new else ""
    delay = float(found["chain"]["delay"]["value"])
    chosen = f": {found['model']}" if fault.model == "auto" else ""
    return (
        f"| {fault.name}{chosen} | {held:.3f} | "
        f"{'' if free is None else f'{free:.3f}'} | {tried:.2f} | {tried_free:.2f} | "
        f"{1e3 * delay:.2f} | {' / '.join(new)}{silent} |"
    )


def beginning(sentence: str) -> str:
    """The first words of a sentence, without its numbers."""
    return re.sub(r"[0-9][0-9.e+-]*", "#", sentence)[:24]


if __name__ == "__main__":
    main()
