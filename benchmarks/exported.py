"""The exported C in time: times real time, against the FMU and against flexstage itself.

`python -m benchmarks.exported` runs it alone. The entire piezo stage: all 60 modes, two drives with
Bouc-Wen hysteresis, amplifiers and creep, a sensor, at 10 kHz, on one core. The last lines say what
the processor would need for as many operations at its best, and to pass the instance's bytes.
Times are those of the processor, which other programs disturb little.
"""

import ctypes
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Iterator, Mapping
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.cases import Row
from benchmarks.hysteresis import Route
from benchmarks.timing import Timed, in_turns
from flexstage.base.arrays import Array
from flexstage.export.fmu.fmu_file import fmu_files
from flexstage.export.realtime import operations, realtime_files
from flexstage.hysteresis import DynamicModel, LogCreep, Sensor, dynamic_model
from flexstage.lumped import lumped_system
from flexstage.stage.designs import design

__all__ = ["exported"]


SAMPLES = 20_000
#: Samples of the route that calls Python in every step.
FEW = 200
ROUNDS = 5
EXACT = ("-std=c99", "-ffp-contract=off")
_DOUBLES = ctypes.POINTER(ctypes.c_double)

_LOOP = """
#include "st.h"
static st_stage stage;
int run(long count, const double *u, double *y);
int run(long count, const double *u, double *y)
{
    st_real now[ST_DRIVES], read[ST_PROBES];
    long i;
    int j;
    st_init(&stage);
    for (j = 0; j < ST_DRIVES; j++)
        now[j] = (st_real)u[j];
    st_settle(&stage, now);
    for (i = 0; i < count; i++) {
        for (j = 0; j < ST_DRIVES; j++)
            now[j] = (st_real)u[i * ST_DRIVES + j];
        if (st_step(&stage, now, read))
            return 1;
        for (j = 0; j < ST_PROBES; j++)
            y[i * ST_PROBES + j] = (double)read[j];
    }
    return 0;
}
"""

_FMU_LOOP = """
typedef int set_real(void *, const unsigned *, unsigned long, const double *);
typedef int get_real(void *, const unsigned *, unsigned long, double *);
typedef int do_step(void *, double, double, int);
int run(long count, const double *u, double *y, set_real *set, do_step *step, get_real *get,
        void *fmu, const unsigned *in, const unsigned *out, double start, double h);
int run(long count, const double *u, double *y, set_real *set, do_step *step, get_real *get,
        void *fmu, const unsigned *in, const unsigned *out, double start, double h)
{
    long i;
    for (i = 0; i < count; i++)
        if (set(fmu, in, 2, u + 2 * i) || step(fmu, start + (double)i * h, h, 1)
            || get(fmu, out, 2, y + 2 * i))
            return 1;
    return 0;
}
"""

# The processor at its best: independent products and sums of vectors, and a pass over an array.
_PEAK = """
#define N 64
static double a[N], b[64 * 1024];
double peak(long count);
double pass(long count, long size);
double peak(long count)
{
    long i;
    int j;
    for (j = 0; j < N; j++)
        a[j] = 1.0 + j;
    for (i = 0; i < count; i++)
        for (j = 0; j < N; j++)
            a[j] = a[j] * 0.999999 + 1e-6;
    return a[3] + a[N - 1];
}
double pass(long count, long size)
{
    double total[8] = {0.0};
    long i, j, k;
    for (i = 0; i < count; i++) {
        b[i % size] = (double)i;
        for (j = 0; j + 8 <= size; j += 8)
            for (k = 0; k < 8; k++)
                total[k] += b[j + k];
    }
    return total[0] + total[7];
}
"""


def commands(count: int) -> Array:
    """Return a triangle of 41 Hz that shrinks, for x, and a raised cosine of 67 Hz, for y [V]."""
    t = np.arange(count) * 1e-4
    ramp = 2.0 * np.abs(41.0 * t - np.floor(41.0 * t + 0.5))
    return np.column_stack(
        (110.0 * (1.0 - 0.1 * t) * ramp, 40.0 - 40.0 * np.cos(2.0 * np.pi * 67.0 * t))
    )


def whole_stage() -> DynamicModel:
    """Return the entire piezo stage."""
    stage = design("vgtu-piezo")
    return dynamic_model(
        stage,
        lumped_system(stage),
        creep=LogCreep(rate_per_decade=0.017),
        bandwidth=1900.0,
        current=0.2,
        sensors={"x": Sensor(gain=1.01, offset=3e-8, bandwidth_hz=4100.0, quantisation=1e-9)},
    )


def _library(folder: Path, source: str, files: Mapping[str, bytes], *flags: str) -> ctypes.CDLL:
    folder.mkdir()
    for name, content in {**files, "loop.c": source.encode()}.items():
        (folder / name).write_bytes(content)
    gcc = shutil.which("gcc")
    if gcc is None:
        raise RuntimeError("the exported C is timed with gcc: install it")
    command = [gcc, *EXACT, *flags, "-shared", "-fPIC", "loop.c", "-o", "loop.so", "-lm"]
    subprocess.run(command, cwd=folder, check=True)
    return ctypes.CDLL(str(folder / "loop.so"))


def _stepping(library: ctypes.CDLL, u: Array) -> Callable[[], Array]:
    library.run.argtypes = (ctypes.c_long, _DOUBLES, _DOUBLES)
    y = np.empty((len(u), 2))

    def work() -> Array:
        if library.run(len(u), u.ctypes.data_as(_DOUBLES), y.ctypes.data_as(_DOUBLES)):
            raise RuntimeError("a step failed")
        return y

    return work


def _fmu(folder: Path, model: DynamicModel, u: Array) -> Callable[[], Array]:
    """Co-simulation of the FMU, called from C: set, step, get in every step."""
    from fmpy import extract, read_model_description
    from fmpy.fmi2 import FMU2Slave

    path = folder / "stage.fmu"
    path.write_bytes(next(iter(fmu_files(model).values())))
    unpacked = extract(str(path))
    described = read_model_description(str(path))
    assert described.coSimulation is not None
    number = {v.name: v.valueReference for v in described.modelVariables}
    inputs = [v.valueReference for v in described.modelVariables if v.causality == "input"]
    outputs = [v.valueReference for v in described.modelVariables if v.causality == "output"]
    slave: Any = FMU2Slave(
        guid=described.guid,
        unzipDirectory=unpacked,
        modelIdentifier=described.coSimulation.modelIdentifier,
        instanceName="timed",
    )
    slave.instantiate()
    loop = _library(folder / "fmu", _FMU_LOOP, {}, "-O2")
    pointer, size = ctypes.c_void_p, ctypes.c_uint * 2
    loop.run.argtypes = (
        ctypes.c_long, _DOUBLES, _DOUBLES, pointer, pointer, pointer, pointer,
        size, size, ctypes.c_double, ctypes.c_double,
    )  # fmt: skip
    library = slave.dll
    call = [
        ctypes.cast(getattr(library, name), pointer)
        for name in ("fmi2SetReal", "fmi2DoStep", "fmi2GetReal")
    ]
    y = np.empty((len(u), 2))
    used = False

    def work() -> Array:
        nonlocal used
        if used:
            slave.reset()
        used = True
        slave.setupExperiment(startTime=0.0)
        if "interpolation" in number:
            kind = next(v.type for v in described.modelVariables if v.name == "interpolation")
            setter = slave.setReal if kind == "Real" else slave.setInteger
            if kind == "Boolean":
                setter = slave.setBoolean
            setter([number["interpolation"]], [1])
        slave.setReal(inputs, u[0].tolist())
        slave.enterInitializationMode()
        slave.exitInitializationMode()
        if loop.run(
            len(u), u.ctypes.data_as(_DOUBLES), y.ctypes.data_as(_DOUBLES), *call,
            slave.component, size(*inputs), size(*outputs), 0.0, model.step,
        ):  # fmt: skip
            raise RuntimeError("a step of the FMU failed")
        return y

    return work


def exported(count: int = SAMPLES) -> Iterator[Row]:
    """Time two seconds of the entire piezo stage by its exported C."""
    model = whole_stage()
    u = commands(count)
    given = {"x": u[:, 0], "y": u[:, 1]}
    files = realtime_files(model, name="st")
    single = realtime_files(model, name="st", precision="single")

    def in_one_call() -> Array:
        read = model.simulate(given).readings
        return np.column_stack([read["x"], read["y"]])

    def one_by_one() -> Array:
        state = model.settled({"x": float(u[0, 0]), "y": float(u[0, 1])})
        out = np.empty((FEW, 2))
        for i in range(FEW):
            now = {"x": u[i : i + 1, 0], "y": u[i : i + 1, 1]}
            found = model.simulate(now, state)
            state = found.state
            out[i] = found.readings["x"][0], found.readings["y"][0]
        return out

    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        works: dict[str, Callable[[], Array]] = {
            "C, one header, double, -O2": _stepping(_library(folder / "a", _LOOP, files, "-O2"), u),
            "C, one header, double, -O3 -march=native": _stepping(
                _library(folder / "b", _LOOP, files, "-O3", "-march=native"), u
            ),
            "C, one header, single, -O2": _stepping(
                _library(folder / "c", _LOOP, single, "-O2"), u
            ),
            "C, one header, single, -O3 -march=native": _stepping(
                _library(folder / "d", _LOOP, single, "-O3", "-march=native"), u
            ),
            "FMU 2.0 co-simulation: set, step, get": _fmu(folder, model, u),
            "flexstage, all samples in one call": in_one_call,
        }
        exact = one_by_one()
        routes = [
            Route(name=name, work=work, words=_off(work(), exact)) for name, work in works.items()
        ]
        routes.append(
            Route(
                name=f"flexstage, sample by sample ({FEW} samples, scaled)",
                work=one_by_one,
                scale=count / FEW,
            )
        )
        routes += list(_floors(folder, model, count))
        case = (
            f"{count * model.step:g} s of {model.name}: {model.omega.size} modes, "
            f"{len(model.drives)} drives, {1.0 / model.step:g} Hz, about {operations(model)} "
            "operations a step"
        )
        times = in_turns([route.work for route in routes], runs=ROUNDS)
        seconds = [t.seconds * r.scale for t, r in zip(times, routes, strict=True)]
        for route, spent in zip(routes, seconds, strict=True):
            words = f"{count * model.step / spent:.3g} times real time; "
            words += f"{1e9 * spent / count:.4g} ns a step"
            yield Row(
                case=case,
                route=route.name,
                time=Timed(seconds=spent),
                ratio=spent / seconds[0],
                limit="; ".join(w for w in (words, route.words) if w),
            )


def _floors(folder: Path, model: DynamicModel, count: int) -> Iterator[Route]:
    """What the processor needs for as many operations, and for the bytes of the instance."""
    # an instance: factors of the modes by 21 tables, and six arrays of modes for each drive
    size = model.omega.size * (2 + 1 + 4 + 13 + 7 * len(model.drives))
    best = _library(folder / "peak", _PEAK, {}, "-O3", "-march=native")
    peak, passes = best.peak, getattr(best, "pass")
    peak.argtypes, peak.restype = (ctypes.c_long,), ctypes.c_double
    passes.argtypes, passes.restype = (ctypes.c_long, ctypes.c_long), ctypes.c_double
    turns = round(count * operations(model) / 128)
    yield Route(name="floor: as many operations, all independent", work=lambda: peak(turns))
    yield Route(
        name=f"floor: a pass over {8 * size / 1024:.0f} kB", work=lambda: passes(count, size)
    )


def _off(found: Array, exact: Array) -> str:
    # quantised readings fall on the next step now and then: y has no sensor
    error = np.abs(found[: len(exact), 1] - exact[:, 1]).max()
    return "same bits as sample by sample" if error == 0.0 else f"error {1e6 * error:.1g} um"


def main() -> None:
    for case, group in groupby(exported(), key=lambda row: row.case):
        print(f"\n{case}")
        for row in group:
            print(f"  {row.route:<55} {row.time!s:>9} {row.ratio:>9.4g}   {row.limit}")


if __name__ == "__main__":
    main()
