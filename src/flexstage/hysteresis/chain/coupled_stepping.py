"""Hysteresis and stage stepped together, whatever form the hysteresis has between samples."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from flexstage.hysteresis.chain.bouc_wen_stage import bouc_wen_with_mode
from flexstage.hysteresis.chain.element import checked_state, positive_step
from flexstage.hysteresis.chain.first_order import lags_through_segments
from flexstage.hysteresis.chain.modal import modes_through_segments, unit_step
from flexstage.hysteresis.chain.polynomial_panels import (
    Panels,
    lags_through_panels,
    modes_through_panels,
    panels,
)
from flexstage.hysteresis.chain.stage_modes import StageModes, values_at_samples
from flexstage.hysteresis.model import Array, HysteresisModel, Segments, samples
from flexstage.hysteresis.models.bouc_wen import BoucWen

#: An output that is known between the samples.
Forcing = Segments | Panels


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class JointResponse:
    """What a stage behind a hysteresis answers."""

    values: Array
    """Output of the stage, shape (n,)."""
    hysteresis_state: Array
    """State of the hysteresis at the last sample."""
    stage_state: Array
    """State of the stage at the last sample."""


def forcing(model: HysteresisModel, u: Array, state: Array) -> Forcing:
    """Return the output of a model from the first to the last sample, known between them.

    The state is that before the first of u; closed form where the model has one, else panels.
    """
    found = model.segments(u, state)
    return panels(model, u, state) if found is None else found


def values_of(force: Forcing) -> Array:
    """Return the values at the samples."""
    return force.samples if isinstance(force, Panels) else values_at_samples(force)


def modes_through(
    force: Forcing,
    angle: Array,
    damping_ratio: Array,
    z: Array,
    v: Array,
    reader: Array,
    y: Array,
) -> None:
    """Step modes through a force, and add their readings.

    Arguments as in `modes_through_segments`, but angle in a step [rad] and damping ratio of each
    mode.
    """
    if isinstance(force, Panels):
        modes_through_panels(force, angle, damping_ratio, z, v, reader, y)
    else:
        modes_through_segments(force, unit_step(angle, damping_ratio), z, v, reader, y)


def lags_through(force: Forcing, ratio: Array, lag: Array, reader: Array, y: Array) -> None:
    """Step lags through an input, and add their readings.

    Arguments as in `lags_through_segments`.
    """
    if isinstance(force, Panels):
        lags_through_panels(force, ratio, lag, reader, y)
    else:
        lags_through_segments(force, ratio, lag, reader, y)


def simulate_with_stage(
    model: HysteresisModel,
    stage: StageModes,
    u: ArrayLike,
    dt: float,
    *,
    hysteresis_state: ArrayLike | None = None,
    stage_state: ArrayLike | None = None,
) -> JointResponse:
    """Return the response of a stage behind a hysteresis, exact for an input of straight lines.

    Parameters
    ----------
    model : HysteresisModel
        The hysteresis.
    stage : StageModes
        The stage.
    u : array_like
        Inputs, shape (n,).
    dt : float
        Step between samples [s].
    hysteresis_state : array_like, optional
        State of the hysteresis one step before the first of them. Where not given the input came
        from rest to the first of them long ago.
    stage_state : array_like, optional
        State of the stage one step before the first of them; given with the other, or not at all.

    Returns
    -------
    JointResponse
        The outputs, and the states at the last sample.

    Raises
    ------
    ModelError
        The input is no finite sequence, the step is not positive, or a state does not belong here.

    Examples
    --------
    >>> import numpy as np
    >>> from flexstage.hysteresis.models.bouc_wen import BoucWen
    >>> model = BoucWen(gain=0.59, hysteresis_gain=0.54, beta=0.05, gamma=0.03)
    >>> stage = StageModes(frequency_hz=[339.0], damping_ratio=[0.012])
    >>> u = 60.0 - 60.0 * np.cos(2.0 * np.pi * 37.0 * np.arange(400) * 1e-4)
    >>> round(float(simulate_with_stage(model, stage, u, 1e-4).values.max()), 6)
    64.864448
    """
    given = samples(u, "input of the hysteresis")
    h = positive_step(dt)
    k = len(stage.frequency_hz)
    now = (
        model.initial_state()
        if hysteresis_state is None
        else np.array(hysteresis_state, np.float64)
    )
    if hysteresis_state is None or stage_state is None:
        first = model.simulate(given[:1], now)
        rest = stage.settled(float(first.values[0]), h)
        # nothing happens in the step before the first sample
        now = first.state
        inputs = np.concatenate((given[:1], given))
    else:
        rest = checked_state(stage_state, 1 + 2 * k, "the stage")
        inputs = np.concatenate((np.atleast_1d(now)[:1], given))
    z, v = rest[1 : 1 + k].copy(), rest[1 + k :] * h
    if k == 1 and isinstance(model, BoucWen) and model.exponent == 1.0:
        return _by_one_loop(model, stage, given, h, np.atleast_1d(now), float(z[0]), float(v[0]))
    force = forcing(model, inputs, now)
    reader = np.concatenate((stage.share, np.zeros(k)))[None, :]
    value = values_of(force)
    y = stage.static_share * value[None, 1:]
    modes_through(force, stage.omega * h, np.array(stage.damping_ratio), z, v, reader, y)
    return JointResponse(
        values=y[0],
        hysteresis_state=force.state,
        stage_state=np.concatenate((value[-1:], z, v / h)),
    )


def _by_one_loop(
    model: BoucWen, stage: StageModes, u: Array, dt: float, state: Array, z: float, v: float
) -> JointResponse:
    before = checked_state(state, 2, "Bouc-Wen")
    numbers = (model.gain, model.hysteresis_gain, model.beta, model.gamma)
    step = unit_step(stage.omega * dt, np.array(stage.damping_ratio))
    y = np.empty_like(u)
    h, z, v = bouc_wen_with_mode(
        u, float(before[0]), float(before[1]), numbers, step, z, v, stage.share[0], y
    )
    if not np.isfinite(h):
        # the model says why
        model.simulate(u, before)
    value = model.gain * float(u[-1]) - h
    return JointResponse(
        values=y,
        hysteresis_state=np.array([u[-1], h]),
        stage_state=np.array([value, z, v / dt]),
    )
