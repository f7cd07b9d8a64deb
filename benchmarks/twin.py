"""The twin in time: times real time, against integrators of the same modes.

`python -m benchmarks.twin` runs it alone. Both axes of the piezo-driven stage at the rate of its
loop; the twin with everything that it has (stacks with memory, creep, amplifiers, converters, all
modes, twelve sensors with noise, mains and drift, position control), the integrators with modes,
creep and Bouc-Wen stacks alone, so that they have the less to do. `solve_ivp` runs for a short
while, and its time is multiplied. Errors are against steps that are exact between the samples.
"""

from collections.abc import Iterator
from itertools import groupby

import numpy as np
from numba import njit

from benchmarks.cases import Row
from benchmarks.hysteresis import Route, rows
from benchmarks.hysteresis_plant import CREEP, STACKS, _Equations
from flexstage.base.arrays import Array
from flexstage.fem.superelement import superelement_model
from flexstage.hysteresis.build_model import dynamic_model
from flexstage.instruments.pi.simulated.controller import VirtualController
from flexstage.stage.designs import design
from flexstage.system import modes
from flexstage.virtual.build import virtual_stage
from flexstage.virtual.stage import VirtualStage

__all__ = ["twin"]


SECONDS = 1.0
FEW = 100
ROUNDS = 5
_BLOCK = 1000


def voltages(count: int, rate_hz: float) -> Array:
    """Return a cosine of 7 Hz for x, and one of 13 Hz for y, both from 0 V."""
    t = np.arange(count) / rate_hz
    return np.array(
        [50.0 - 50.0 * np.cos(2.0 * np.pi * f * t) for f in (7.0, 13.0)], dtype=np.float64
    )


@njit(cache=True)
def _runge_kutta(  # pragma: no cover - compiled
    omega: Array, zeta: Array, push: Array, probes: Array, lags: Array, lag_gain: float,
    stacks: Array, u: Array, dt: float, parts: int,
) -> Array:  # fmt: skip
    """Integrate modes, creep and Bouc-Wen stacks, `parts` classical steps a sample."""
    k, a, m = omega.size, stacks.shape[0], lags.size
    size = 2 * k + a * (m + 1)
    x, h = np.zeros(size), dt / parts
    out = np.zeros((probes.shape[0], u.shape[1]))
    slopes = np.zeros((4, size))
    trial = np.zeros(size)
    for n in range(u.shape[1] - 1):
        for p in range(parts):
            for stage in range(4):
                back = (0.0, 0.5, 0.5, 1.0)[stage]
                for i in range(size):
                    trial[i] = x[i] + (back * h * slopes[stage - 1, i] if stage else 0.0)
                d = slopes[stage]
                d[:] = 0.0
                for j in range(a):
                    du = (u[j, n + 1] - u[j, n]) / dt
                    at = u[j, n] + du * (p + back) * h
                    own = 2 * k + j * (m + 1)
                    z = trial[own + m]
                    w = stacks[j, 0] * at - z
                    d[own + m] = (
                        stacks[j, 1] * du - stacks[j, 2] * abs(du) * z - stacks[j, 3] * du * abs(z)
                    )
                    total = w
                    for i in range(m):
                        d[own + i] = (w - trial[own + i]) / lags[i]
                        total += lag_gain * trial[own + i]
                    for i in range(k):
                        d[k + i] += push[i, j] * total
                for i in range(k):
                    d[i] = trial[k + i]
                    d[k + i] -= omega[i] ** 2 * trial[i] + 2.0 * zeta[i] * omega[i] * trial[k + i]
            for i in range(size):
                x[i] += (
                    h / 6.0 * (slopes[0, i] + 2 * slopes[1, i] + 2 * slopes[2, i] + slopes[3, i])
                )
        for r in range(probes.shape[0]):
            for i in range(k):
                out[r, n + 1] += probes[r, i] * x[i]
    return out


def twin(seconds: float = SECONDS) -> Iterator[Row]:
    """Time one second of the piezo stage, both axes."""
    stage = design("vgtu-piezo")
    slow, fast = (
        virtual_stage(stage, model="superelement", seed=1, sample_rate_hz=rate)
        for rate in (10e3, 20e3)
    )
    system = superelement_model(stage).system
    rate = slow.sample_rate_hz
    count, dt = int(seconds * rate), 1.0 / rate
    u = voltages(count, rate)
    limits = [slow.limits[a].position for a in slow.axes]
    wanted = np.array(
        [p[0] + (p[1] - p[0]) * v / 110.0 for p, v in zip(limits, u, strict=True) if p is not None]
    )

    def blocks(which: VirtualStage, command: Array, servo: bool) -> None:
        for first in range(0, command.shape[1], _BLOCK):
            which.run(command[:, first : first + _BLOCK], [servo] * len(which.axes))

    controller = VirtualController(virtual_stage(stage, model="superelement", seed=1))

    plant = dynamic_model(stage, system, time_step=dt, hysteresis=STACKS, creep=CREEP)
    found = modes(system, drives="in place", count=None)
    ports = [system.drive(stage.axis(a).drive) for a in STACKS]
    push = np.array([(p.stiffness or 0.0) * (p.vector @ found.shapes) for p in ports]).T.copy()
    probes = np.array([p.vector @ found.shapes for p in system.probes])
    numbers = np.array([(s.gain, s.hysteresis_gain, s.beta, s.gamma) for s in STACKS.values()])
    # the fastest mode must turn by less than about 2.8 rad a step, or the method diverges
    parts = int(np.ceil(found.omega.max() * dt / 2.0))

    def integrated(n: int) -> Array:
        return _runge_kutta(
            found.omega, np.asarray(found.damping_ratio), push, probes, CREEP.time_constants,
            CREEP.lag_gain, numbers, u[:, :n], dt, parts,
        )  # fmt: skip

    def exact(n: int) -> Array:
        given = dict(zip(STACKS, u[:, :n], strict=True))
        read = plant.simulate(given, plant.settled()).readings
        return np.array([read[p.name] for p in system.probes])

    equations = _Equations(system)
    few = {name: v[:FEW] for name, v in zip(STACKS, u, strict=True)}

    def by_scipy() -> Array:
        return equations.integrated(few, "RK45", 1e-6, split=False).T

    def off(y: Array, n: int) -> str:
        # the plant's first sample is one step after rest; both begin at 0 V
        return f"error {1e6 * np.abs(y - exact(n)).max():.1g} um"

    routes = [
        Route(name="twin, position control, 10 kHz", work=lambda: blocks(slow, wanted, True)),
        Route(name="twin, open loop, 10 kHz", work=lambda: blocks(slow, u, False)),
        Route(
            name="twin, position control, 20 kHz",
            work=lambda: blocks(fast, np.repeat(wanted, 2, axis=1), True),
        ),
        Route(name="twin with its controller, at rest", work=lambda: controller.advance(seconds)),
        Route(name="plant, exact between samples, no loop", work=lambda: exact(count)),
        Route(
            name=f"compiled Runge-Kutta, {parts} steps a sample, no loop",
            work=lambda: integrated(count),
            words=off(integrated(1000), 1000),
        ),
        Route(
            name=f"scipy solve_ivp, RK45, rtol 1e-6 ({FEW} samples, scaled), no loop",
            work=by_scipy,
            scale=(count - 1) / (FEW - 1),
            words=off(by_scipy(), FEW),
        ),
    ]
    case = f"{seconds:g} s of vgtu-piezo, {system.order} modes, two axes"
    for row in rows(case, routes, samples=count, rounds=ROUNDS):
        speed = seconds / row.time.seconds
        yield Row(
            case=row.case,
            route=row.route,
            time=row.time,
            ratio=row.ratio,
            limit=f"{speed:.3g} times real time; {row.limit}",
        )


def main() -> None:
    for case, group in groupby(twin(), key=lambda row: row.case):
        print(f"\n{case}")
        for row in group:
            print(f"  {row.route:<60} {row.time!s:>9} {row.ratio:>9.4g}   {row.limit}")


if __name__ == "__main__":
    main()
