"""The entire dynamic model of a stage in time: times real time, against integrators.

`python -m benchmarks.hysteresis_plant` runs it alone. Both stacks of the piezo-driven stage, with
Bouc-Wen hysteresis and creep, move all modes of its superelements at 10 kHz; routes that integrate
do so for a short while, and their time is multiplied. Errors are against steps that are split at
the samples, in um.
"""

from collections.abc import Iterator
from functools import cached_property
from itertools import groupby
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp
from scipy.signal import StateSpace, lsim

from benchmarks.cases import Row
from benchmarks.hysteresis import Route, rows
from flexstage.base.arrays import Array
from flexstage.fem.superelement import superelement_model
from flexstage.hysteresis import BoucWen
from flexstage.hysteresis.build_model import dynamic_model
from flexstage.hysteresis.chain.creep import LogCreep
from flexstage.hysteresis.chain.sensor import Sensor
from flexstage.stage import Stage
from flexstage.stage.designs import design
from flexstage.system import MechanicalSystem, modes
from flexstage.virtual.stack import virtual_stack

__all__ = ["plant"]


DT = 1e-4
SAMPLES = 10_000
#: Samples that routes which integrate are timed on, and errors are measured on.
FEW = 200
ROUNDS = 5
STACKS = {
    "x": BoucWen(gain=0.38e-6, hysteresis_gain=0.11e-6, beta=0.05, gamma=0.03),
    "y": BoucWen(gain=0.33e-6, hysteresis_gain=0.07e-6, beta=0.04, gamma=0.03),
}
CREEP = LogCreep(rate_per_decade=0.015)


def voltages(count: int) -> dict[str, Array]:
    """Return a triangle of 41 Hz that shrinks, for x, and a raised cosine of 67 Hz, for y."""
    t = np.arange(count) * DT
    ramp = 2.0 * np.abs(41.0 * t - np.floor(41.0 * t + 0.5))
    return {
        "x": 110.0 * (1.0 - 0.4 * t) * ramp,
        "y": 40.0 - 40.0 * np.cos(2.0 * np.pi * 67.0 * t),
    }


class _Equations:
    """The equations of first order of all modes and of the creep of both stacks."""

    def __init__(self, system: MechanicalSystem) -> None:
        result = modes(system, drives="in place", count=None)
        self._omega = result.omega
        n, m = result.omega.size, CREEP.time_constants.size
        self.names = tuple(STACKS)
        lags = len(self.names) * m
        a = np.zeros((2 * n + lags, 2 * n + lags))
        b = np.zeros((2 * n + lags, len(self.names)))
        a[:n, n : 2 * n] = np.eye(n)
        a[n : 2 * n, :n] = -np.diag(result.omega**2)
        a[n : 2 * n, n : 2 * n] = -np.diag(2.0 * result.damping_ratio * result.omega)
        for j, name in enumerate(self.names):
            port = system.drive(name)
            assert port.stiffness is not None
            push = result.shapes.T @ port.vector * port.stiffness
            own = slice(2 * n + j * m, 2 * n + (j + 1) * m)
            b[n : 2 * n, j] = push
            a[n : 2 * n, own] = CREEP.lag_gain * push[:, None]
            a[own, own] = -np.diag(1.0 / CREEP.time_constants)
            b[own, j] = 1.0 / CREEP.time_constants
        probes = np.array([p.vector for p in system.probes])
        c = np.zeros((probes.shape[0], a.shape[0]))
        c[:, :n] = probes @ result.shapes
        self.a, self.b, self.c = a, b, c

    @cached_property
    def space(self) -> Any:
        """The equations as SciPy knows them."""
        return StateSpace(self.a, self.b, self.c, np.zeros((self.c.shape[0], self.b.shape[1])))

    def sampled(self, u: dict[str, Array], *, lines: bool) -> Array:
        """Return readings where free displacements are taken to be straight, or held."""
        free = np.column_stack([STACKS[name].simulate(u[name]).values for name in self.names])
        t = np.arange(free.shape[0]) * DT
        return np.asarray(lsim(self.space, free, t, interp=lines)[1])

    def integrated(self, u: dict[str, Array], method: str, rtol: float, *, split: bool) -> Array:
        """Return readings by `solve_ivp`, from rest, for voltages of straight lines."""
        volts = np.array([u[name] for name in self.names])
        slopes = np.diff(volts, axis=1, append=volts[:, -1:]) / DT
        numbers = np.array(
            [(s.gain, s.hysteresis_gain, s.beta, s.gamma) for s in STACKS.values()]
        ).T
        d, hysteresis_gain, beta, gamma = numbers
        count, last = self.a.shape[0], volts.shape[1] - 1

        def rates(t: float, state: Array, at: int | None = None) -> Array:
            i = min(int(t / DT), last) if at is None else at
            x, h, du = state[:count], state[count:], slopes[:, i]
            w = d * (volts[:, i] + du * (t - i * DT)) - h
            made = np.empty_like(state)
            made[:count] = self.a @ x + self.b @ w
            made[count:] = hysteresis_gain * du - beta * np.abs(du) * h - gamma * du * np.abs(h)
            return made

        start = np.zeros(count + len(self.names))
        scale: Any = {"method": method, "rtol": rtol, "atol": 1e-10 * rtol}
        if not split:
            t = np.arange(last + 1) * DT
            found: Any = solve_ivp(rates, (0.0, t[-1]), start, t_eval=t, **scale)
            return (self.c @ found.y[:count]).T
        out = [self.c @ start[:count]]
        for i in range(last):
            step: Any = solve_ivp(rates, (i * DT, (i + 1) * DT), start, args=(i,), **scale)
            start = step.y[:, -1]
            out.append(self.c @ start[:count])
        return np.array(out)


def plant(count: int = SAMPLES) -> Iterator[Row]:
    """Time one second of the piezo stage, all modes, both drives."""
    stage: Stage = design("vgtu-piezo")
    system = superelement_model(stage).system
    equations = _Equations(system)
    ours = dynamic_model(stage, system, time_step=DT, hysteresis=STACKS, creep=CREEP)
    u, few = voltages(count), voltages(FEW)
    exact = equations.integrated(few, "DOP853", 1e-12, split=True)
    invented = {
        axis: virtual_stack((0.0, 120.0), stage.drive(stage.axis(axis).drive).free_stroke, 0.12)  # type: ignore[union-attr]
        for axis in STACKS
    }
    whole = dynamic_model(
        stage,
        system,
        time_step=DT,
        hysteresis=invented,
        creep=CREEP,
        bandwidth=700.0,
        current=0.5,
        sensors={name: Sensor(noise_rms=5e-9, seed=3) for name in STACKS},
    )

    def off(y: Array) -> str:
        return f"error {1e6 * np.abs(y - exact).max():.1g} um"

    def by_flexstage(volts: dict[str, Array]) -> Array:
        found = ours.simulate(volts).readings
        return np.column_stack([found[p.name] for p in system.probes])

    def integrated(method: str) -> Array:
        return equations.integrated(few, method, 1e-8, split=False)

    share = (count - 1) / (FEW - 1)
    slow = f"rtol 1e-8 ({FEW} samples, scaled)"
    routes = [
        Route(
            name="flexstage, Bouc-Wen and creep",
            work=lambda: by_flexstage(u),
            words=off(by_flexstage(few)),
        ),
        Route(
            name="flexstage, virtual stacks, amplifiers, sensors",
            work=lambda: whole.simulate(u),
        ),
        Route(
            name="scipy lsim, straight between samples",
            work=lambda: equations.sampled(u, lines=True),
            words=off(equations.sampled(few, lines=True)),
        ),
        Route(
            name="scipy lsim, held between samples",
            work=lambda: equations.sampled(u, lines=False),
            words=off(equations.sampled(few, lines=False)),
        ),
        *(
            Route(
                name=f"scipy solve_ivp, {method}, {slow}",
                work=lambda m=method: integrated(m),
                scale=share,
                words=off(integrated(method)),
            )
            for method in ("RK45", "LSODA")
        ),
    ]
    case = f"{count * DT:g} s of vgtu-piezo, {system.order} modes, two drives, {1 / DT:g} Hz"
    for row in rows(case, routes, samples=count, rounds=ROUNDS):
        speed = count * DT / row.time.seconds
        yield Row(
            case=row.case,
            route=row.route,
            time=row.time,
            ratio=row.ratio,
            limit=f"{speed:.3g} times real time; {row.limit}",
        )


def main() -> None:
    for case, group in groupby(plant(), key=lambda row: row.case):
        print(f"\n{case}")
        for row in group:
            print(f"  {row.route:<60} {row.time!s:>9} {row.ratio:>9.4g}   {row.limit}")


if __name__ == "__main__":
    main()
