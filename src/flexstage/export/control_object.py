"""Linear state-space form of a stage, also for python-control."""

from typing import TYPE_CHECKING

import numpy as np

from flexstage.hysteresis.dynamic_model import DynamicModel
from flexstage.hysteresis.model import Array
from flexstage.system import MechanicalSystem, StateSpace, state_space

if TYPE_CHECKING:
    import control


def linear_part(model: DynamicModel) -> StateSpace:
    r"""Return the state space from the free displacements of all drives to the true motion.

    States are the modes, their rates, then the lags of the drives in order. Inputs are free
    displacements [m], or forces [N]; amplifier, hysteresis or gain, and sensors are not included.

    With creep and lags l of each drive, :math:`f = w + a \sum_i l_i`, the modes obey
    :math:`\eta'' + 2\zeta\omega\eta' + \omega^2\eta = \omega^2 g (f + t f')`; t is 0 unless the
    displacement is imposed; then the second state is :math:`\eta' - \omega^2 t g f`.

    Examples
    --------
    >>> from flexstage.stage.designs import design
    >>> from flexstage.hysteresis import dynamic_model
    >>> from flexstage.lumped import lumped_system
    >>> stage = design("vgtu-piezo")
    >>> form = linear_part(dynamic_model(stage, lumped_system(stage), keep_modes=6))
    >>> form.A.shape, form.inputs
    ((12, 12), ('x [m]', 'y [m]'))
    """
    k = model.omega.size
    rates = [np.zeros(0) if d.creep is None else 1.0 / d.creep.time_constants for d in model.drives]
    n = 2 * k + sum(r.size for r in rates)
    a, b = np.zeros((n, n)), np.zeros((n, len(model.drives)))
    c, feed = np.zeros((len(model.probes), n)), np.zeros((len(model.probes), len(model.drives)))
    a[:k, k : 2 * k] = np.eye(k)
    a[k : 2 * k, :k] = -np.diag(model.omega**2)
    a[k : 2 * k, k : 2 * k] = -np.diag(2.0 * model.damping_ratio * model.omega)
    c[:, :k] = model.probe_shapes
    at = 2 * k
    for j, (d, rate) in enumerate(zip(model.drives, rates, strict=True)):
        by_rate = model.omega**2 * d.rate_time * d.modal_gain
        b[:k, j] = by_rate
        b[k : 2 * k, j] = (
            model.omega**2 * d.modal_gain - 2.0 * model.damping_ratio * model.omega * by_rate
        )
        feed[:, j] = d.feedthrough
        lag_rows = slice(at, at + rate.size)
        at += rate.size
        if d.creep is not None:
            a[:, lag_rows] += d.creep.lag_gains * b[:, j : j + 1]
            c[:, lag_rows] = d.creep.lag_gains * feed[:, j : j + 1]
            a[lag_rows, lag_rows] = -np.diag(rate)
            b[lag_rows, j] = rate
    return StateSpace(
        A=a,
        B=b,
        C=c,
        D=feed,
        inputs=tuple(f"{d.name} [{'N' if d.stiffness == 0.0 else 'm'}]" for d in model.drives),
        outputs=tuple(f"{p.name} [{p.unit}]" for p in model.probes),
    )


def rest_shape(model: DynamicModel) -> Array:
    """Return the states of `linear_part` at rest for a unit of each input, a column each.

    It equals ``-inv(A) B``, without the rounding errors of this stiff inverse.
    """
    form = linear_part(model)
    k = model.omega.size
    at = 2 * k
    rest = np.zeros_like(form.B)
    for j, d in enumerate(model.drives):
        count = 0 if d.creep is None else d.creep.time_constants.size
        force = 1.0 if d.creep is None else d.creep.static_gain
        rest[:k, j] = force * d.modal_gain
        rest[k : 2 * k, j] = -force * model.omega**2 * d.rate_time * d.modal_gain
        rest[at : at + count, j] = 1.0
        at += count
    return rest


def state_names(model: DynamicModel) -> tuple[str, ...]:
    """Return name and unit of each state of `linear_part`."""
    k = model.omega.size
    names = [f"mode {i + 1} [kg^0.5 m]" for i in range(k)]
    names += [f"mode {i + 1} rate [kg^0.5 m/s]" for i in range(k)]
    for d in model.drives:
        taus = [] if d.creep is None else d.creep.time_constants.tolist()
        names += [f"{d.name} lag {tau:.4g} s [m]" for tau in taus]
    return tuple(names)


def control_system(model: DynamicModel | MechanicalSystem) -> "control.StateSpace":
    """Return a stage as a state space of the python-control library.

    For a dynamic model it is the `linear_part`, for a system it has the drives in place. Inputs are
    the free displacements of the drives [m], or forces [N], outputs the readings, with names. The
    package python-control is needed.

    Notes
    -----
    Validity: hysteresis, gains from voltage to free displacement, amplifiers and sensors are not
    included; connect them in series.
    """
    form = linear_part(model) if isinstance(model, DynamicModel) else state_space(model)
    return form.to_control()
