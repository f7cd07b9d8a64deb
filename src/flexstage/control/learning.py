r"""Iterative learning over whole periods, in the frequency domain.

A motion that repeats leaves the same error in every period, and what it needs can be learned from
one trial to the next. With the error :math:`E_k(f)` of trial k, averaged over its periods,

.. math:: X_{k+1}(f) = X_k(f) + \alpha\, w_k(f)\, \hat G(f)^{-1} E_k(f)

where X is what the model of the hysteresis has to give, :math:`\hat G` the linear chain after it,
and the voltage follows from X by the inverse of the hysteresis over a period that repeats. Seen
from X the drive is linear as far as the model is right: :math:`G = \hat G (1 + \Delta)`. Each
harmonic contracts by
:math:`|1 - \alpha w (1 + \Delta)| \le |1 - \alpha w| + \alpha w |\Delta| < 1` for every
:math:`\alpha w \le 1` as long as the model error :math:`|\Delta| < 1`; this is the condition of
S. Arimoto and others (J. Robotic Systems 1 (1984) 123) for one harmonic. The weights
:math:`w = \max(0, 1 - N^2/|E|^2)` take a harmonic only as far as it stands out of its noise N,
which is seen between the periods of the trial, and near a mode only as far as its frequency is
known. A trial that is worse than the best one by more than a quarter is taken back and the step
halved, so that what is tried stays near the best, and what is returned is never worse than the
start. In open loop creep and drift go on between the trials; learning follows them, and the last
of the good trials is the one to use.

Under a position control the learned voltages are added to its own. Of what is added it leaves the
sensitivity :math:`S = 1/(1 + C P)`, so that :math:`\hat G` becomes :math:`\hat G S`, and its
integral holds the mean, which is not learned. A slow loop is enough: it takes up creep and drift,
learning takes what repeats.
"""

from collections.abc import Callable, Mapping

from flexstage.control.learning_axis import (
    AxisLearner,
    Learning,
    LearningSettings,
    ResponseOf,
    mean_error,
)
from flexstage.control.trajectory import Trajectory
from flexstage.hysteresis import DriveModel
from flexstage.instruments.protocol import Waveform
from flexstage.records import Record
from flexstage.stage.limits import AxisLimits
from flexstage.system.servo import ServoSettings


def learn(
    run: Callable[[Waveform], Record],
    reference: Trajectory,
    start: Waveform,
    model: Mapping[str, DriveModel | ResponseOf],
    settings: LearningSettings | None = None,
    *,
    limits: Mapping[str, AxisLimits] | None = None,
    columns: Mapping[str, str] | None = None,
    servo: Mapping[str, ServoSettings] | None = None,
) -> Learning:
    """Learn what makes a stage follow a trajectory that repeats.

    Parameters
    ----------
    run : callable
        Runs one period again and again and returns a record that ends with as many whole periods
        as are averaged, without what settles before them. Time 0 of the record is the first sample
        of a period.
    reference : Trajectory
        What is wanted.
    start : Waveform
        One period to begin with, at the rate of the reference: voltages, or targets of a control.
    model : Mapping
        By axis: the identified drive, for voltages in open loop, or the response of the reading to
        what is learned, a function from frequencies [Hz] to complex values, for all else.
    settings : LearningSettings, optional
        How it is learned.
    limits : Mapping, optional
        Limits by axis; what they do not allow is not tried.
    columns : Mapping, optional
        Column of the reading by axis; that of the axis's name where not given.
    servo : Mapping, optional
        Settings of the position control by axis, for voltages that are added to its own while it
        follows the trajectory; the trajectory then has the rate of the loop. Open loop where not
        given.

    Returns
    -------
    Learning
        The best period, and what every trial gave.

    Raises
    ------
    ModelError
        Start and reference do not fit together, or an axis has no model.
    RecordError
        A record has too few periods.

    Notes
    -----
    Validity: learns what the sensor reads. What the sensor has of the mains is learned where the
    trajectory repeats with it, and it cannot be told from a motion. Run the periods of a trial in
    two halves then, half a period of the mains apart, and return the mean of both; the control must
    not follow the mains either (`tune` with ``mains_hz``).

    A drive that cycles for minutes creeps by about one part in a hundred: motions need as much room
    to the ends of its range, or the control rests there and what is learned grows worse.
    """
    how = settings or LearningSettings()
    known, loops = limits or {}, servo or {}
    axes = {a: AxisLearner(reference, start, model, a, how, known.get(a), loops.get(a))
            for a in reference.axes}  # fmt: skip
    trial = start
    for number in range(how.trials + 1):
        record = run(trial)
        for axis, own in axes.items():
            column = (columns or {}).get(axis, axis)
            error, noise = mean_error(record, column, reference, axis, how.periods)
            own.take(number, error, noise)
        if number == how.trials or all(own.reason for own in axes.values()):
            break
        trial = Waveform(
            values={a: own.next() for a, own in axes.items()},
            sample_rate_hz=start.sample_rate_hz,
            quantity=start.quantity,
        )
    best = Waveform(
        values={a: own.chosen()[0] for a, own in axes.items()},
        sample_rate_hz=start.sample_rate_hz,
        quantity=start.quantity,
    )
    return Learning(
        waveform=best,
        axes={a: own.result() for a, own in axes.items()},
        settings=how,
        notes=tuple(note for own in axes.values() for note in own.notes),
    )
