"""Settings of a position control from an identified drive, with stated margins."""

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from flexstage.base.arrays import Array
from flexstage.base.errors import ModelError
from flexstage.control.loop_plant import (
    LoopPlant,
    Margins,
    gain_margin,
    loop_frequencies,
    loop_margins,
    loop_plant,
    step_response,
    worst_of,
)
from flexstage.hysteresis import DriveModel, StageModes
from flexstage.system.servo import Filter, ForceFeedback, Notch, PositionFeedback, ServoSettings

#: Candidate damping ratios of the poles of a notch.
WIDTHS = (0.3, 0.5, 0.7, 1.0)
#: Candidate ratios of proportional to integral gain, over the delay of the loop.
_LEADS = (0.0, 0.25, 0.5, 0.75, 1.0, 1.5, 2.0)
#: Candidate corners of a low-pass over the first mode, and shallow notches at it. Their phase lag
#: makes the loop damp the mode.
_CORNERS = (0.6, 0.7, 0.8, 0.9, 1.0, 1.1, 1.2, 1.35, 1.5, 2.0)
_SHALLOW = (None, (0.3, 0.7))
#: A mode whose peak adds less than this to the response needs no notch.
_WORTH = 0.02
#: Damping of the poles of a mains notch: narrow, since its phase costs bandwidth.
_MAINS_WIDTH = 0.15


@dataclass(frozen=True, slots=True, kw_only=True)
class Requirements:
    """Requirements on a loop, at every gain and frequency that its plant may have.

    Raises
    ------
    ModelError
        No loop can meet a requirement.
    """

    gain_margin: float = 2.0
    """Smallest gain margin [1]."""
    phase_margin: float = math.radians(40.0)
    """Smallest phase margin [rad]."""
    sensitivity_peak: float = 2.0
    """Largest sensitivity Ms [1]."""
    gain_scatter: float = 0.1
    """Relative uncertainty of the gain beyond the range of the model [1]."""
    frequency_scatter: float = 0.03
    """Relative uncertainty of the natural frequencies of the model [1]."""

    def __post_init__(self) -> None:
        if not (self.gain_margin > 1.0 and 0.0 < self.phase_margin < 0.5 * math.pi):
            raise ModelError(
                "a loop needs a gain margin above 1 and a phase margin of 0 to 90 degrees, got "
                f"{self.gain_margin!r} and {math.degrees(self.phase_margin):.4g} degrees"
            )
        if not self.sensitivity_peak > 1.0:
            raise ModelError(
                f"the sensitivity peak of every loop exceeds 1, so its limit must too; got "
                f"{self.sensitivity_peak!r}"
            )
        if not (0.0 <= self.gain_scatter < 1.0 and 0.0 <= self.frequency_scatter < 0.5):
            raise ModelError(
                "scatter of gain and frequency must be 0 to 1 and 0 to 0.5, got "
                f"{self.gain_scatter!r} and {self.frequency_scatter!r}"
            )


@dataclass(frozen=True, slots=True, kw_only=True)
class ServoDesign:
    """Settings of a control, with the margins that they keep."""

    settings: ServoSettings
    """The settings."""
    nominal: Margins
    """Margins at the mean gain and the frequencies of the model."""
    worst: Margins
    """The worst of each margin over the required gains and frequencies; bandwidth and crossover are
    the lowest.
    """
    requirements: Requirements
    """The requirements."""
    plant: LoopPlant
    """The plant."""
    notes: tuple[str, ...] = field(default=())
    """Limits of the loop."""


def tune(
    model: DriveModel,
    *,
    sample_rate_hz: float,
    delay: float | None = None,
    kind: str = "auto",
    requirements: Requirements | None = None,
    mains_hz: float | None = None,
    resonance: tuple[float, float] | None = None,
) -> ServoDesign:
    """Return settings for the position control of an identified drive.

    Parameters
    ----------
    model : DriveModel
        The drive: voltage [V] to reading [m].
    sample_rate_hz : float
        Rate of the loop [Hz].
    delay : float, optional
        Delay of the loop [s], as of `loop_plant`; from the model where not given.
    kind : {"auto", "integral", "pi", "damping"}
        Integral with notches, proportional and integral with notches, a loop whose phase damps the
        first mode, or the best of them: see `tune_plant`.
    requirements : Requirements, optional
        Requirements on the loop (default: `Requirements`).
    mains_hz : float, optional
        Frequency of a disturbance of the sensor that the stage must not follow [Hz]: for a
        reference that is much slower, or one whose voltages are learned.
    resonance : tuple of float, optional
        Frequency [Hz] and damping ratio of the first mode with the drives in place, for a model
        that has none, such as one from a record that was too slow to show it. Without either the
        margins are those of a stage without resonance, and the notes say so.

    Returns
    -------
    ServoDesign
        The settings and their margins.

    Raises
    ------
    ModelError
        No gain keeps the requirements, or the model cannot be controlled.
    """
    plant = loop_plant(model, sample_rate_hz, delay=delay)
    if resonance is not None and plant.modes is None:
        mode = StageModes(frequency_hz=[resonance[0]], damping_ratio=[resonance[1]])
        plant = replace(plant, modes=mode)
    return tune_plant(plant, kind=kind, requirements=requirements, mains_hz=mains_hz)


def tune_plant(
    plant: LoopPlant,
    *,
    kind: str = "auto",
    requirements: Requirements | None = None,
    mains_hz: float | None = None,
) -> ServoDesign:
    r"""Return the settings with the largest integral gain that keeps the requirements.

    The inverse of the integral gain measures the slow error (K. J. Astrom, H. Panagopoulos, T.
    Hagglund, Automatica 34 (1998) 585, who maximise it under a bound on Ms). For each structure its
    largest value follows in closed form at every frequency: :math:`|1 + k L_1| \ge 1/M_s` fails
    first at the smaller root of a quadratic in k, and gain and phase margins at a crossing. A loop
    is stable at small gain, and none of its zeros crosses the unit circle before that: it is
    stable.

    With a notch a loop does not see its mode, which decays by its own damping. With a low-pass
    instead, the lag of the loop makes feedback take energy out of the mode, at the cost of integral
    gain. ``auto`` chooses, of all structures at their largest gain, the one with the smallest error
    after small steps of the drive, such as a hysteresis makes at a reversal:
    :math:`\int |P/(1 + L)|^2 / \omega^2 \, d\omega`.

    Examples
    --------
    >>> from flexstage.hysteresis import StageModes
    >>> plant = LoopPlant(
    ...     gain=5e-7, gain_range=(4e-7, 6e-7), delay=2e-4, sample_rate_hz=10e3,
    ...     modes=StageModes(frequency_hz=[910.0], damping_ratio=[0.01]),
    ... )
    >>> tuned = tune_plant(plant, kind="integral")
    >>> round(tuned.worst.sensitivity_peak, 3), round(tuned.settings.notches[0].frequency_hz)
    (2.0, 910)
    """
    if kind not in ("auto", "integral", "pi", "damping"):
        raise ModelError(f"a control is 'auto', 'integral', 'pi' or 'damping', got {kind!r}")
    required = requirements or Requirements()
    best: ServoSettings | None = None
    value = 0.0
    cases = list(_cases(plant, required))
    # a larger gain of the plant is a larger gain of the loop: the others follow
    loudest = [c for c in cases if c.gain == max(c.gain for c in cases)]
    for unit in structures(plant, kind, mains_hz):
        gain = _largest_gain(loudest, unit, required) * (1.0 - 1e-9)
        if not gain > 0.0:
            continue
        trial = unit.scaled(gain)
        score = 1.0 / _left_of_steps(plant, trial) if kind == "auto" else gain
        if score > value:
            value, best = score, trial
    if best is None:
        raise ModelError(
            "no gain keeps the margins at every gain and frequency of the plant: reduce the "
            "requirements, or identify the stage more exactly"
        )
    margins = [loop_margins(case, best) for case in cases]
    nominal = loop_margins(plant, best)
    return ServoDesign(
        settings=best,
        nominal=nominal,
        worst=worst_of(margins),
        requirements=required,
        plant=plant,
        notes=_notes(plant, best, required, mains_hz),
    )


def _cases(plant: LoopPlant, required: Requirements) -> list[LoopPlant]:
    """Return the plant at the extremes of its gain and frequencies, and at their means."""
    low = (1.0 - required.gain_scatter) * plant.gain_range[0] / plant.gain
    high = (1.0 + required.gain_scatter) * plant.gain_range[1] / plant.gain
    frequencies = [1.0] if plant.modes is None else [
        1.0 + s * required.frequency_scatter for s in (-1.0, -0.5, 0.0, 0.5, 1.0)
    ]  # fmt: skip
    return [plant.scattered(g, f) for g in (low, 1.0, high) for f in frequencies]


def structures(plant: LoopPlant, kind: str, mains_hz: float | None) -> Iterator[ServoSettings]:
    """Yield controllers of unit integral gain; their proportional gain is in units of it [s]."""
    mains: tuple[Notch, ...] = ()
    if mains_hz is not None:
        mains = (Notch(frequency_hz=mains_hz, zero_damping=0.0, pole_damping=_MAINS_WIDTH),)
    scale = plant.delay + plant.time_constant + 0.5 / plant.sample_rate_hz
    if kind != "damping" or plant.modes is None:
        leads = {"integral": _LEADS[:1], "pi": _LEADS[1:]}.get(kind, _LEADS)
        for width, lead in itertools.product(WIDTHS, leads):
            notches = peak_notches(plant, width)
            yield ServoSettings(integral=1.0, proportional=lead * scale, notches=(*notches, *mains))
    if kind in ("integral", "pi") or plant.modes is None:
        return
    first = min(plant.modes.frequency_hz)
    for corner, shallow, lead in itertools.product(_CORNERS, _SHALLOW, _LEADS[:5]):
        if corner * first >= 0.45 * plant.sample_rate_hz:
            continue
        notches = () if shallow is None else (
            Notch(frequency_hz=first, zero_damping=shallow[0], pole_damping=shallow[1]),
        )  # fmt: skip
        yield ServoSettings(
            integral=1.0, proportional=lead * scale, lowpass_hz=corner * first,
            notches=(*notches, *mains),
        )  # fmt: skip


def peak_notches(plant: LoopPlant, width: float) -> tuple[Notch, ...]:
    """Return a notch on every mode that needs one."""
    if plant.modes is None:
        return ()
    highest = 0.45 * plant.sample_rate_hz
    rows = zip(plant.modes.frequency_hz, plant.modes.damping_ratio, plant.modes.share, strict=True)
    return tuple(
        Notch(frequency_hz=f, zero_damping=max(zeta, 0.005), pole_damping=max(width, 2.0 * zeta))
        for f, zeta, share in rows
        if f < highest and abs(share) > _WORTH * zeta and zeta < 0.5
    )


def robust_filters(
    plant: LoopPlant, settings: ServoSettings, excess: float = 0.1
) -> tuple[Filter, ...]:
    r"""Return filters in series with a control that let its loop err most, or none.

    Loop shaping by H-infinity (D. McFarlane, K. Glover, IEEE Trans. Autom. Control 37 (1992) 759):
    with plant and control as G, from the stabilising solutions of two Riccati equations,

    .. math:: A_0^T X + X A_0 - X B S^{-1} B^T X + C^T R^{-1} C = 0, \qquad
              A_0 Z + Z A_0^T - Z C^T R^{-1} C Z + B S^{-1} B^T = 0

    with :math:`A_0 = A - B S^{-1} D C` and :math:`R = S = 1 + D^2`. Every G whose normalised
    coprime factors err by less than :math:`1/\gamma` is stable with the filters, where
    :math:`\gamma` exceeds the least one, :math:`\sqrt{1 + \rho(X Z)}`. The bilinear transform
    between the sampled loop and these equations keeps both.

    Parameters
    ----------
    plant : LoopPlant
        Gain, modes and delay.
    settings : ServoSettings
        The control [V/m] that shapes the loop.
    excess : float
        Excess of :math:`\gamma` over the least one [1], positive.

    Returns
    -------
    tuple of Filter
        The filters, at the rate of the plant; none where they would not be stable themselves.

    Notes
    -----
    Validity: of this gain of the loop and these modes. Another gain has other margins.
    """
    from scipy.linalg import LinAlgError, solve_continuous_are
    from scipy.signal import ss2zpk, zpk2sos

    a, b, c, d = _shaped_loop(plant, settings)
    unit = np.eye(len(a))
    inverse = np.linalg.inv(a + unit)
    d -= float((c @ inverse @ b)[0, 0])
    a, b, c = (a - unit) @ inverse, inverse @ b, c @ inverse
    b, c = math.sqrt(2.0) * b, math.sqrt(2.0) * c
    size = 1.0 + d * d
    inner = a - b @ c * (d / size)
    try:
        by_rows = solve_continuous_are(inner, b, c.T @ c / size, [[size]])
        by_columns = solve_continuous_are(inner.T, c.T, b @ b.T / size, [[size]])
    except LinAlgError:
        return ()  # a loop of zero at a pole on the axis, say
    radius = float(np.abs(np.linalg.eigvals(by_rows @ by_columns)).max())
    square = (1.0 + excess) ** 2 * (1.0 + radius)
    feedback = -(d * c + b.T @ by_rows) / size
    pull = (1.0 - square) * unit + by_rows @ by_columns
    column = square * np.linalg.solve(pull.T, by_columns @ c.T)
    states = a + b @ feedback + column @ (c + d * feedback)
    # the solution is for positive feedback
    row = -b.T @ by_rows
    inverse = np.linalg.inv(unit - states)
    sampled = (inverse @ (unit + states), math.sqrt(2.0) * inverse @ column)
    direct = d + row @ inverse @ column
    row = math.sqrt(2.0) * row @ inverse
    zeros, poles, gain = ss2zpk(*sampled, row, np.atleast_2d(direct))
    if np.abs(poles).max() >= 1.0:
        return ()
    sections = zpk2sos(zeros, poles, gain)
    return tuple(Filter(**dict(zip(("b0", "b1", "b2", "a1", "a2"), row, strict=True)))
                 for row in np.delete(sections, 3, axis=1).tolist())  # fmt: skip


def _shaped_loop(plant: LoopPlant, settings: ServoSettings) -> tuple[Array, Array, Array, float]:
    """Return A, B, C and D of a sampled plant behind its control."""
    from scipy.linalg import block_diag

    step = 1.0 / plant.sample_rate_hz
    late = math.ceil(plant.delay / step - 1e-9)
    within = max(late * step - plant.delay, 0.0)
    blocks, rows, columns = [], [], []
    direct = 1.0
    for pole, residue in zip(*step_response(plant.modes, plant.time_constant), strict=True):
        turn, amplitude = np.exp(pole * step), residue * np.exp(pole * within)
        direct += float(amplitude.real)
        row = amplitude * (turn - 1.0)
        if pole.imag > 0.0:
            blocks.append([[turn.real, -turn.imag], [turn.imag, turn.real]])
            rows += [2.0 * row.real, -2.0 * row.imag]
            columns += [1.0, 0.0]
        elif pole.imag == 0.0:
            blocks.append([[turn.real]])
            rows.append(row.real)
            columns.append(1.0)
    proportional, integral = plant.gain * settings.proportional, plant.gain * settings.integral
    parts = [(block_diag(*blocks) if blocks else np.zeros((0, 0)), columns, rows, direct)]
    parts.append((np.eye(late, k=-1), [1.0, *[0.0] * (late - 1)], [*[0.0] * (late - 1), 1.0], 0.0)
                 if late else (np.zeros((0, 0)), [], [], 1.0))  # fmt: skip
    parts.append((np.eye(1), [1.0], [integral * step], proportional + integral * step))
    for b0, b1, b2, a1, a2 in settings.sections(plant.sample_rate_hz).tolist():
        states = np.array([[-a1, -a2], [1.0, 0.0]])
        parts.append((states, [1.0, 0.0], [b1 - a1 * b0, b2 - a2 * b0], b0))
    a, b, c, d = np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((1, 0)), 1.0
    for states, column, row, through in parts:
        into, out = np.reshape(column, (-1, 1)), np.reshape(row, (1, -1))
        a = np.block([[a, np.zeros((len(a), len(states)))], [into @ c, states]])
        b, c, d = np.vstack((b, into * d)), np.hstack((through * c, out)), through * d
    return a, b, c, d


def position_filter(
    mode_hz: float, static_gain: float, stage_gain: float, delay: float = 0.0
) -> PositionFeedback:
    r"""Return the positive position feedback that damps a mode most, for its static gain.

    Without delay, a filter of :math:`\omega_f = \omega/\sqrt{1-g}` and :math:`\zeta_f = \sqrt g`
    makes the poles of mode and filter one double pair with

    .. math:: \zeta = \tfrac12 \sqrt{g/(1-g)}

    With a delay, the filter has at the mode the size and the phase of that one without.

    Parameters
    ----------
    mode_hz : float
        Frequency of the mode [Hz].
    static_gain : float
        Static gain g of the loop by this mode alone, 0 to 1.
    stage_gain : float
        Static reading over voltage of the mode [m/V].
    delay : float
        Delay of the loop with its hold [s].

    Returns
    -------
    PositionFeedback
        The filter.

    Raises
    ------
    ModelError
        The static gain is not between 0 and 1, where the loop becomes unstable, or the delay turns
        the phase by more than a filter can make up for.

    Examples
    --------
    >>> position_filter(800.0, 0.36, 5e-7)
    PositionFeedback(gain=720000.0, frequency_hz=1000.0, damping_ratio=0.6)
    """
    if not 0.0 < static_gain < 1.0:
        raise ModelError(
            "the static gain of a position feedback must be between 0 and 1, where it becomes "
            f"unstable, got {static_gain!r}"
        )
    g = static_gain
    turned = (g + 2j * math.sqrt(g * (1.0 - g))) * np.exp(-2j * np.pi * mode_hz * delay)
    if not (turned.imag > 0.0 and turned.real < 1.0):
        raise ModelError(
            f"a delay of {1e6 * delay:.4g} us leaves a position feedback no phase at {mode_hz:.4g} "
            "Hz: reduce the delay, or choose control 'damping'"
        )
    ratio = math.sqrt(1.0 - turned.real)
    return PositionFeedback(
        gain=g / stage_gain,
        frequency_hz=mode_hz / ratio,
        damping_ratio=float(turned.imag) / (2.0 * ratio),
    )


def force_feedback(
    mode_hz: float, zero_hz: float, static_force: float
) -> tuple[ForceFeedback, float]:
    r"""Return the integral force feedback that damps a mode most, and that damping ratio.

    For the force of a single mode with its zero z below its pole w, both without damping, the
    largest ratio and its gain are

    .. math:: \zeta = \frac{\omega - z}{2 z}, \qquad
              g = \frac{\omega}{f_0} \Bigl(\frac{z}{\omega}\Bigr)^{3/2}

    with the static force f_0 over voltage (A. Preumont, Vibration Control of Active Structures: the
    gain is :math:`\omega\sqrt{\omega/z}` of the force far above the mode). From a ratio of 1 on,
    where :math:`\omega \ge 3 z`, the mode no longer vibrates at that gain.

    Parameters
    ----------
    mode_hz, zero_hz : float
        Frequency of the mode and of the zero below it [Hz].
    static_force : float
        Static force of the stack over voltage [N/V].

    Returns
    -------
    tuple of ForceFeedback and float
        Its gain, and the damping ratio without delay.

    Raises
    ------
    ModelError
        The zero is not below the mode, as of a sensor that is not in line with the stack.

    Examples
    --------
    >>> feedback, ratio = force_feedback(800.0, 400.0, 5.0)
    >>> round(feedback.gain, 2), ratio
    (355.43, 0.5)
    """
    if not 0.0 < zero_hz < mode_hz:
        raise ModelError(
            f"the zero of the force, {zero_hz:.4g} Hz, must be below the mode at {mode_hz:.4g} Hz: "
            "the sensor must be in line with the stack (collocated)"
        )
    gain = 2.0 * math.pi * mode_hz * (zero_hz / mode_hz) ** 1.5 / static_force
    return ForceFeedback(gain=gain), (mode_hz - zero_hz) / (2.0 * zero_hz)


def _left_of_steps(plant: LoopPlant, settings: ServoSettings) -> float:
    """Return the integral of the squared error of a loop after a unit step of the drive [s]."""
    f = loop_frequencies(plant, settings)
    omega = 2.0 * np.pi * f
    response = plant.response(f)
    residual = response / plant.gain / (1.0 + settings.response(f, plant.sample_rate_hz) * response)
    return float(np.trapezoid(np.abs(residual) ** 2 / omega**2, omega)) / np.pi


def _largest_gain(cases: list[LoopPlant], unit: ServoSettings, required: Requirements) -> float:
    """Return the largest gain below which no requirement fails in any case."""
    gain = math.inf
    for plant in cases:
        f = loop_frequencies(plant, unit)
        loop = unit.response(f, plant.sample_rate_hz) * plant.response(f)
        size2, re = np.abs(loop) ** 2, loop.real
        # the smaller root of |1 + k L|^2 = 1/Ms^2, where it is real and positive
        inside = re**2 - size2 * (1.0 - required.sensitivity_peak**-2)
        meets = (inside >= 0.0) & (re < 0.0)
        if meets.any():
            root = (-re[meets] - np.sqrt(inside[meets])) / size2[meets]
            gain = min(gain, float(root.min()))
        # sizes at which the phase leaves less than its margin
        near = np.abs(np.angle(-loop)) < required.phase_margin
        if near.any():
            gain = min(gain, 1.0 / float(np.abs(loop[near]).max()))
        gain = min(gain, gain_margin(loop) / required.gain_margin)
    return gain if math.isfinite(gain) else 0.0


def _notes(
    plant: LoopPlant, settings: ServoSettings, required: Requirements, mains_hz: float | None
) -> tuple[str, ...]:
    notes = []
    if plant.modes is not None:
        first, zeta = plant.modes.frequency_hz[0], plant.modes.damping_ratio[0]
        bare = 4.0 * math.pi * zeta * first / plant.gain
        filter_effect = "the low-pass damps the mode and" if settings.lowpass_hz else "the notch"
        notes.append(
            f"{filter_effect} allows an integral gain of {settings.integral / bare:.3g} times the "
            f"limit without a filter, 2 zeta omega / gain; the mode at {first:.4g} Hz may shift by "
            f"{100.0 * required.frequency_scatter:.3g} %"
        )
    else:
        notes.append(
            "the plant has no mode: a stage with one becomes unstable with these settings; measure "
            "it with a small multisine or a hammer, drives in place, and give it as the resonance"
        )
    if mains_hz is not None:
        notes.append(
            f"the stage neither follows the reference nor corrects errors at {mains_hz:g} Hz: for "
            f"references whose harmonics stay below {0.3 * mains_hz:.3g} Hz, or whose voltages are "
            "learned"
        )
    return tuple(notes)
