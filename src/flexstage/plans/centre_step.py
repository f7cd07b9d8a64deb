"""The step that centres an encoder scale with the stage."""

import json
import math
from dataclasses import asdict
from pathlib import Path

import numpy as np

from flexstage.centring.head_averaging import against_reference
from flexstage.centring.procedure import centre
from flexstage.centring.rotary_table import CentreReading, table_reading
from flexstage.centring.virtual_table import VirtualTable
from flexstage.errors import PlanError
from flexstage.plans.files import write_text
from flexstage.plans.positioner import InstrumentPositioner
from flexstage.plans.recorded import park
from flexstage.plans.results import CentredStep
from flexstage.plans.results_centring import CentredMove
from flexstage.plans.verbs import Centre
from flexstage.plans.work import Work

_ORDERS = range(1, 25)
_NOTES = ("table and heads are simulated; the scale is where the stage's sensors say that it is",)


class _Bench:
    """A simulated table, whose scale is carried by the stage of an instrument."""

    def __init__(self, table: VirtualTable, positioner: InstrumentPositioner, angle: float) -> None:
        self._table, self._positioner = table, positioner
        c, s = math.cos(angle), math.sin(angle)
        self._turn = np.array([[c, -s], [s, c]])
        self.true_lengths: list[float] = []

    def measure(self) -> CentreReading:
        """Turn the table and return the eccentricity of the scale."""
        x, y = self._turn @ self._positioner.reading()
        moved = self._table.moved(float(x), float(y))
        angle, *errors = (c.values for c in moved.record(index=len(self.true_lengths)).channels)
        self.true_lengths.append(float(np.hypot(*moved.apparent_eccentricity)))
        found = against_reference(angle, np.stack(errors), heads=self._table.heads, orders=_ORDERS)
        return table_reading(found, self._table.radius)


def centre_scale(work: Work, name: str, action: Centre) -> Path:
    """Centre the scale, and write every measurement and move."""
    park(work.instrument, action.axes)
    first, second = (int(work.plan.sensor(s).channel) for s in action.sensors)
    positioner = InstrumentPositioner(
        work.instrument,
        work.stage,
        action.axes,
        (first, second),
        closed_loop=action.closed_loop,
    )
    positioner.to_middle()
    table = VirtualTable(
        radius=action.radius,
        heads=action.heads,
        eccentricity=action.eccentricity,
        noise=action.noise,
        seed=int(action.seed),
    )
    bench = _Bench(table, positioner, action.mounting_angle)
    done = centre(bench, positioner, target=action.target, moves=int(action.moves))
    moves = []
    for step, true in zip(done.steps, bench.true_lengths, strict=True):
        length = step.reading.length
        moves.append(
            CentredMove(
                kind=step.kind,
                command=(float(step.command[0]), float(step.command[1])),
                eccentricity=(float(step.reading.vector[0]), float(step.reading.vector[1])),
                length=length.value,
                uncertainty=length.expanded,
                predicted=None if step.predicted is None else step.predicted.value,
                true_length=true,
            )
        )
    result = CentredStep(
        name=name,
        axes=action.axes,
        target=action.target,
        reached=done.reached,
        reason=done.reason,
        moves=tuple(moves),
        notes=_NOTES,
    )
    target = work.folder / "records" / f"{name}.json"
    write_text(target, json.dumps(asdict(result), indent=1) + "\n")
    return target


def centred_from(work: Work, name: str, action: Centre, file: Path) -> CentredStep:
    """Return the result of a step from its file."""
    del work, action
    try:
        read = json.loads(file.read_text(encoding="utf-8"))
        moves = tuple(
            CentredMove(
                **{**m, "command": tuple(m["command"]), "eccentricity": tuple(m["eccentricity"])}
            )
            for m in read.pop("moves")
        )
        own = {**read, "axes": tuple(read["axes"]), "notes": tuple(read["notes"])}
        return CentredStep(**{**own, "moves": moves})
    except (ValueError, KeyError, TypeError) as error:
        raise PlanError(f"'{file}' is no result of step '{name}': {error}") from error
