"""Characteristics of many stages at once, by the names and with the values of a single analysis."""

from abc import ABC, abstractmethod
from collections.abc import Collection
from functools import cached_property
from typing import Any

import numpy as np

from flexstage.base.arrays import Array
from flexstage.base.choose import did_you_mean
from flexstage.base.errors import ModelError
from flexstage.system.batch import SystemBatch, namespace_of, samples_last
from flexstage.system.batch_figures import Decisions, StageFigures, decisions
from flexstage.system.batch_modes import DrivenReading, Form, applied, axis_modes, total
from flexstage.system.block_cholesky import factorise
from flexstage.system.coupled_axes import COUPLED
from flexstage.system.figure_source import Key, added
from flexstage.system.forward_mode import root

# Figures that say nothing of how a stage moves: a mechanism has them as well.
_DESCRIBED = ("mass", "moving_mass", "width", "height", "thickness")


def batch_characteristics(
    batch: SystemBatch, keys: Collection[Key] | None = None
) -> dict[Key, Array]:
    r"""Return the characteristics of many stages of one topology.

    The same names, axes and values as `flexstage.system.analyse` gives for each: one factor
    :math:`K = L L^T` of each stage serves all of its statics and the iteration for its natural
    frequencies (`flexstage.system.batch_modes`).

    Parameters
    ----------
    batch : SystemBatch
        The systems.
    keys : Collection of tuple, optional
        Figures as quantity and axis, ``("transmission_ratio", "x")``; all where not given. Nothing
        else is computed.

    Returns
    -------
    dict
        By quantity and axis the values, shape (S,). Not a number for a stage that can move without
        deforming a hinge, and for one of which other figures are quoted than of the nominal stage:
        whose axes are coupled where those of that one are not, or the other way round.

    Raises
    ------
    ModelError
        A figure is not available for this topology.

    Notes
    -----
    Validity: as the model. The nominal stage decides which figures are quoted. An axis of which
    more drives than axes make the motion is left to `flexstage.system.analyse`, and so is the
    workspace of two displacements and a rotation by more than three drives.

    A value does not depend on the other samples, to the last bit.

    Examples
    --------
    >>> from flexstage.stage.designs import design
    >>> from flexstage.lumped import assemble_batch, stage_arrays
    >>> batch = assemble_batch(stage_arrays([design("vgtu-piezo")]))
    >>> found = batch_characteristics(batch, [("natural_frequency_hz", "x")])
    >>> print(f"{found['natural_frequency_hz', 'x'][0]:.2f} Hz")
    325.96 Hz
    """
    decided = decisions(batch.stage, batch.nominal)
    source = _Values(batch, decided)
    figures = source.figures = StageFigures(decided, source)
    rows = figures.rows
    selected = list(rows) if keys is None else list(keys)
    require_known(batch, selected, rows)
    source.shapes = any(name in ("effective_mass", "effective_inertia") for name, _ in selected)
    xp, out = source.xp, {}
    # a mechanism divides by nothing, and is no number in the end
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        moving = any(name not in _DESCRIBED for name, _ in selected)
        sure = _sure(figures, source) if moving else None
        for key in selected:
            value = rows[key]()
            if key[0] not in _DESCRIBED:
                value = xp.where(sure, value, xp.nan)
            out[key] = xp.broadcast_to(value, (batch.samples,))
    return out


def quoted(batch: SystemBatch) -> tuple[Key, ...]:
    """Return the figures that a batch gives, by quantity and axis, without computing them."""
    decided = decisions(batch.stage, batch.nominal)
    return tuple(StageFigures(decided, _Values(batch, decided)).rows)


def require_known(batch: SystemBatch, keys: Collection[Key], available: Collection[Key]) -> None:
    """Refuse figures that are not available, and list those that are."""
    texts = [f"{quantity} of {axis}" for quantity, axis in available]
    for key in keys:
        if key not in available:
            name = f"{key[0]} of {key[1]}"
            raise ModelError(
                f"a batch of stage '{batch.stage.name}' does not give {name}, only "
                f"{', '.join(texts)}; the analysis of a single stage may give "
                f"more{did_you_mean(name, texts)}"
            )


def _sure(figures: StageFigures, source: "_Values") -> Array:
    """Return the samples that are no mechanisms, and coupled if the nominal stage is."""
    xp, fine = source.xp, source.fine()
    coupling = figures.coupling
    if coupling is None or any(len(axis.drives) > 1 for axis in coupling.nominal.axes):
        return fine
    nominal = coupling.nominal
    coupled = xp.zeros_like(fine)
    for i, axis in enumerate(nominal.axes):
        j = nominal.drives.index(axis.drives[0])
        own_motion = xp.abs(coupling.scaled[i][j])
        for k, other in enumerate(nominal.axes):
            if other.drives != axis.drives:
                size = xp.abs(coupling.scaled[k][j])
                coupled = xp.logical_or(coupled, size > COUPLED * own_motion)
    return xp.logical_and(fine, coupled if nominal.coupled else xp.logical_not(coupled))


class FieldSource(ABC):
    """Ingredients of figures that are fields of a batch."""

    batch: SystemBatch

    @abstractmethod
    def last(self, name: str) -> Any:
        """Return a field of the batch with samples last."""

    def of_drive(self, field: str, drive: int) -> Any:
        """Return a field of the batch that is given by drive."""
        return self.last(field)[drive, ...]

    def strength(self, which: int) -> Any:
        """Return the yield strength, or the largest pulsating stress [Pa]."""
        return self.last("strength")[which, ...]

    def length(self, drives: tuple[int, ...], probe: int) -> Any:
        """Return the mean distance of the points of some drives from that of a probe [m]."""
        at, to = self.last("drive_at"), self.last("probe_at")[probe, ...]
        apart = [at[j, ...] - to for j in drives]
        squares = [d[0, ...] * d[0, ...] + d[1, ...] * d[1, ...] for d in apart]
        return added([root(square) for square in squares]) / len(drives)

    def masses(self) -> list[Any]:
        """Return the mass of every body [kg]."""
        mass = self.last("body_mass")
        return [mass[i, ...] for i in range(self.batch.body_mass.shape[1])]

    def size(self, which: int) -> Any:
        """Return width, height or thickness of the plate [m]."""
        return self.last("size")[which, ...]


class _Values(FieldSource):
    """Ingredients of figures, over the samples of a batch."""

    figures: StageFigures
    shapes = False

    def __init__(self, batch: SystemBatch, decided: Decisions) -> None:
        self.batch, self.decisions, self.xp = batch, decided, namespace_of(batch)
        self._last: dict[str, Array] = {}
        self._stress: dict[int, Array] = {}

    def last(self, name: str) -> Array:
        if name not in self._last:
            self._last[name] = samples_last(self.xp, getattr(self.batch, name))
        return self._last[name]

    @cached_property
    def mass(self) -> Array:
        """Diagonal of M by body."""
        mass = self.last("mass")
        return self.xp.reshape(mass, (-1, 3, mass.shape[-1]))

    @cached_property
    def blocks(self) -> dict[tuple[int, int], Array]:
        """Blocks of K."""
        k = self.last("stiffness")
        return {at: k[i, ...] for i, at in enumerate(self.batch.blocks)}

    @cached_property
    def factor(self) -> Any:
        """The factor of K."""
        return factorise(self.xp, self.mass.shape[0], self.blocks)

    def form(self, kind: str, which: int) -> Form:
        """The vector of a drive or a probe, by body."""
        rows = self.last(kind)
        bodies = getattr(self.batch, f"{kind}_bodies")[which]
        return [(body, rows[which, side, ...]) for side, body in enumerate(bodies) if body >= 0]

    def _solved(self, forms: list[Form]) -> Array:
        """Shapes for forces, (k, 3, r, S)."""
        xp, parts = self.xp, []
        for body in range(self.mass.shape[0]):
            columns = [_of_body(form, body) for form in forms]
            if all(c is None for c in columns):
                parts.append(None)
                continue
            nothing = next(c for c in columns if c is not None) * 0.0
            filled = [nothing if c is None else c for c in columns]
            parts.append(xp.stack(xp.broadcast_arrays(*filled), axis=1))
        return self.factor.solve(parts)

    @cached_property
    def _drives(self) -> Array:
        """Shapes for a unit force of each drive."""
        return self._solved([self.form("drive", j) for j in range(len(self.batch.drive_bodies))])

    @cached_property
    def _probes(self) -> tuple[dict[int, int], Array]:
        """Shapes for a unit force along the probe of each axis, and where each probe is."""
        names = [probe.name for probe in self.batch.nominal.probes]
        read = list(dict.fromkeys(names.index(axis.probe) for axis in self.decisions.axes))
        shapes = self._solved([self.form("probe", p) for p in read])
        return {p: i for i, p in enumerate(read)}, shapes

    def _shape(self, probe: int) -> Array:
        where, shapes = self._probes
        return shapes[:, :, where[probe], :]

    def gram(self, i: int, j: int) -> Array:
        # symmetric: taken once
        i, j = min(i, j), max(i, j)
        return applied(self.form("drive", i), self._drives[:, :, j : j + 1, :])[0, ...]

    def reach(self, probe: int, drive: int) -> Array:
        return applied(self.form("probe", probe), self._drives[:, :, drive : drive + 1, :])[0, ...]

    def self_response(self, probe: int) -> Array:
        shape = self._shape(probe)[:, :, None, :]
        return applied(self.form("probe", probe), shape)[0, ...]

    def _weighed(self, probe: int, shape: Array) -> Array:
        """Work of the weight along the direction of a probe on a shape."""
        along = self.last("weight_direction")
        c, s = along[probe, 0, ...], along[probe, 1, ...]
        moved = shape[:, 0, ...] * c + shape[:, 1, ...] * s
        return total(self.last("weight") * moved, 1)

    def sag(self, probe: int) -> Array:
        return self._weighed(probe, self._shape(probe))

    def sag_drive(self, probe: int, drive: int) -> Array:
        return self._weighed(probe, self._drives[:, :, drive, :])

    def stress(self, drive: int) -> Array:
        if drive not in self._stress:
            self._stress[drive] = self._stresses(self._drives[:, :, drive, :])
        return self._stress[drive]

    def _stresses(self, shape: Array) -> Array:
        xp, rows = self.xp, self.last("stress")
        # the ground, which does not move, comes last
        moved = xp.concat((shape, xp.zeros_like(shape[:1, ...])))
        ground = shape.shape[0]
        parts = []
        for side in (0, 1):
            bodies = [b[side] if b[side] >= 0 else ground for b in self.batch.stress_bodies]
            at = xp.take(moved, xp.asarray(bodies, dtype=xp.int64), axis=0)
            parts += [rows[:, side, c, :] * at[:, c, :] for c in range(3)]
        return added(parts)

    def rotation(self, probe: int, drive: int) -> Array:
        body = self.batch.probe_bodies[probe][0]
        turned = self._drives[body, 2, drive, :]
        return turned if body >= 0 else turned * 0.0

    @cached_property
    def _modes(self) -> tuple[list[Array], list[Array]]:
        responses = []
        for axis in self.figures.axes:
            force = axis.motion[1]
            form = [(b, f * row) for j, f in force.items() for b, row in self.form("drive", j)]
            pushed = added(
                [f * g * self.gram(i, j) for i, f in force.items() for j, g in force.items()]
            )
            reading = self.form("probe", axis.probe)
            responses.append(
                DrivenReading(
                    force=form, reading=reading, pushed=pushed, read=self.self_response(axis.probe)
                )
            )
        return axis_modes(
            self.factor,
            self.blocks,
            self.mass,
            self.decisions.start,
            responses,
            count=self.batch.samples,
            shapes=self.shapes,
        )

    def mode(self, axis: int) -> tuple[Array, Array]:
        squared, read_squares = self._modes
        return squared[axis], read_squares[axis]

    def fine(self) -> Array:
        return self.factor.regular


def _of_body(form: Form, body: int) -> Array | None:
    """The part of a vector that belongs to a body, None where there is none."""
    rows = [row for b, row in form if b == body]
    return added(rows) if rows else None
