"""The stiffness of a seat that a measured natural frequency would imply."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from flexstage.base.errors import ModelError
from flexstage.quantities.estimate import Estimate
from flexstage.stage import Stage
from flexstage.stage.drive import Drive, Force
from flexstage.stage.seat import BallSeat, FlatSeat, Preload, Seat
from flexstage.system.characteristics import axis_mode
from flexstage.system.mechanical import AxisPort, MechanicalSystem
from flexstage.system.modes import Modes, modes
from flexstage.system.statics import analyse_axis

#: Relative standard uncertainty of a computed natural frequency without drives [1]: necks that are
#: 11 um off in x, or 7 um in y, do as much on the piezo stage of the study.
BARE_UNCERTAINTY = 0.02
#: Relative tolerance of the free stroke of a stack, as its makers print it [1].
STROKE_TOLERANCE = 0.10
#: Contacts from the least to the most compliant one, of which each may have closed.
CONTACTS: Mapping[str, Seat] = {
    "ball of radius 10 mm, steel on steel": BallSeat(radius=10e-3, contact_modulus=115.4e9),
    "ground flat, 0.1 um": FlatSeat(roughness_length=0.1e-6),
    "rough flat, 0.72 um": FlatSeat(roughness_length=0.72e-6),
}
# half width of a two-sided 95 % interval of the normal distribution
_NORMAL = 1.959963984540054
# relative change of a frequency over which its slope is found
_STEP = 1e-4
# relative change of a force at which it is found
_SETTLED = 1e-12


@dataclass(frozen=True, slots=True, kw_only=True)
class ImpliedSeat:
    """What a measured natural frequency of an axis would say of the seat of its drive.

    Stiffness is in N/m, infinite where even a rigid seat is too soft.
    """

    axis: str
    """Name of the axis."""
    drive: str
    """Its drive."""
    measured_hz: float
    """The measured frequency [Hz]."""
    bare_hz: float
    """That of the model without stiffness of the drives [Hz]."""
    ideal_hz: float
    """That of the model with the drive on rigid seats [Hz]."""
    added_stiffness: float
    """Stiffness that the drive would add; negative where the frequency is below the bare one."""
    added_uncertainty: float
    """Its standard uncertainty."""
    added_interval: tuple[float, float]
    """Its two-sided 95 % interval; not negative."""
    seat_interval: tuple[float, float]
    """Two-sided 95 % interval of the stiffness of the seat in series with the drive."""
    seat_stiffness: float | None
    """Stiffness of the seat; None where `seat_interval` only gives an upper bound."""
    share_left: float
    """Part of the free stroke that a linear seat of this stiffness would leave by one mode [1]."""
    measured_share: float | None
    """Part of the free stroke that the measured stroke is [1]; None without a measured stroke."""
    least_stroke_stiffness: float | None
    """Stiffness of a linear seat that leaves the measured stroke of a stack with a free stroke at
    the upper end of its tolerance.
    """
    closed_hz: Mapping[str, float]
    """Frequency at half stroke with each of `CONTACTS` closed, whose preload makes the measured
    frequency at rest, or its upper bound [Hz].
    """

    @property
    def contradicted(self) -> bool:
        """The measured stroke wants a stiffer seat than the frequency allows."""
        return (
            self.least_stroke_stiffness is not None
            and self.least_stroke_stiffness > self.seat_interval[1]
        )


def implied_seat(
    stage: Stage,
    system: MechanicalSystem,
    axis: str,
    measured: Estimate,
    *,
    measured_stroke: float | None = None,
) -> ImpliedSeat:
    r"""Return what a measured natural frequency would say of the seat of the drive of an axis.

    .. math:: \frac{1}{k(\omega)} = \sum_i \frac{(d^T \phi_i)^2}{\omega^2 - \omega_i^2}, \quad
              k_c = \frac{k k_s}{k_s - k}

    k is the stiffness that a drive with elongation :math:`d^T q` adds where the stage has its
    measured frequency, with all modes of the stage without it, and :math:`k_c` that of a seat in
    series with the stiffness :math:`k_s` of the drive. Of one mode
    :math:`k = k_{in} [(f/f_0)^2 - 1]`.

    Parameters
    ----------
    stage : Stage
        The stage; seats and preload of this drive are ignored, the other drives have only a mass.
    system : MechanicalSystem
        A model of it.
    axis : str
        Name of the axis, which one drive moves.
    measured : Estimate
        Its measured frequency [Hz] with its uncertainty.
    measured_stroke : float, optional
        Reading of the probe that was measured over the whole stroke of the drive [m].

    Returns
    -------
    ImpliedSeat
        The stiffness, what the stroke says against it, and the frequency that would decide.

    Raises
    ------
    ModelError
        There is no such axis, several drives move it, or its drive is a pure force; or the
        frequency is not positive.

    Notes
    -----
    Validity: small vibrations, a linear model, and relative errors of both frequencies that are
    normal. A contact has its tangent in the frequency, and a secant in the stroke.
    """
    drive, port = _driven(stage, system, axis)
    if measured.value <= 0.0:
        raise ModelError("a frequency must be positive")
    added = _AddedStiffness(system, port, drive.spring)
    f, u = measured.value, math.hypot(measured.uncertainty / measured.value, BARE_UNCERTAINTY)
    ends = [added(f * math.exp(sign * _NORMAL * u)) for sign in (-1.0, 1.0)]
    interval = (max(ends[0], 0.0), max(ends[1], 0.0))
    here, slope = added(f), (added(f * (1.0 + _STEP)) - added(f * (1.0 - _STEP))) / (2.0 * _STEP)
    pushed = analyse_axis(system, port)
    k_in, ratio = pushed.input_stiffness, pushed.output_displacement / pushed.input_displacement
    bound = here <= 0.0
    seats = (_seat(interval[0], drive.spring), _seat(interval[1], drive.spring))
    share = None
    if measured_stroke is not None and drive.stroke:
        share = measured_stroke / ratio / drive.stroke
    seat = None if bound else _seat(here, drive.spring)
    return ImpliedSeat(
        axis=axis,
        drive=drive.name,
        measured_hz=f,
        bare_hz=added.bare_hz,
        ideal_hz=added.ideal_hz,
        added_stiffness=here,
        added_uncertainty=slope * u,
        added_interval=interval,
        seat_interval=seats,
        seat_stiffness=seat,
        share_left=max(1.0 - (added.bare_hz / f) ** 2, 0.0),
        measured_share=share,
        least_stroke_stiffness=None
        if share is None
        else _seat_of_share(share / (1.0 + STROKE_TOLERANCE), k_in, drive.spring),
        closed_hz=_closed(drive, added, k_in, seats[1] if seat is None else seat),
    )


def _driven(stage: Stage, system: MechanicalSystem, axis: str) -> tuple[Drive, AxisPort]:
    port = next((a for a in system.axes if a.name == axis), None)
    if port is None:
        raise ModelError(f"the stage has no axis '{axis}'")
    drive = stage.drive(port.drive)
    if isinstance(drive, Force):
        raise ModelError(f"drive '{drive.name}' is a pure force, which has no seats")
    return drive, port


class _AddedStiffness:
    """Stiffness of a drive that gives an axis a frequency."""

    def __init__(self, system: MechanicalSystem, axis: AxisPort, spring: float | None) -> None:
        self._system, self._axis, self._spring = system, axis, spring
        self._bare = self._modes(0.0)
        self._elongation = system.drive(axis.drive).vector @ self._bare.shapes
        self.bare_hz = self._frequency(self._bare)
        self.ideal_hz = self.frequency_hz(spring)

    def __call__(self, frequency_hz: float) -> float:
        """Return the stiffness [N/m]; negative below the frequency without drives."""
        if frequency_hz >= self.ideal_hz:
            return math.inf if self._spring is None else self._spring
        apart = (2.0 * math.pi * frequency_hz) ** 2 - self._bare.omega**2
        if not apart.all():
            return 0.0
        stiffness = 1.0 / float(np.sum(self._elongation**2 / apart))
        return min(stiffness, 0.0) if frequency_hz < self.bare_hz else stiffness

    def frequency_hz(self, stiffness: float | None) -> float:
        """Return the frequency of the axis with a stiffness of its drive, None if rigid [Hz]."""
        return self._frequency(self._modes(stiffness))

    def _modes(self, stiffness: float | None) -> Modes:
        drives = (
            replace(d, stiffness=stiffness if d.name == self._axis.drive else 0.0)
            for d in self._system.drives
        )
        return modes(replace(self._system, drives=tuple(drives)), drives="in place", count=None)

    def _frequency(self, result: Modes) -> float:
        mode = axis_mode(self._system, result, self._axis.drive, self._axis.probe)
        return float(result.frequency_hz[mode])


def _seat(stiffness: float, spring: float | None) -> float:
    """Return the stiffness in series with that of a drive."""
    if spring is None:
        return stiffness
    return stiffness * spring / (spring - stiffness) if stiffness < spring else math.inf


def _seat_of_share(share: float, k_in: float, spring: float | None) -> float:
    """Return the stiffness of a seat that leaves a share of the free stroke."""
    return _seat(k_in * share / (1.0 - share), spring) if share < 1.0 else math.inf


def _closed(
    drive: Drive, added: _AddedStiffness, k_in: float, seat_stiffness: float
) -> dict[str, float]:
    """Return the frequency at half stroke with each contact closed."""
    rates: dict[str, float] = {}
    if not 0.0 < seat_stiffness < math.inf or not drive.stroke:
        return rates
    for name, contact in CONTACTS.items():
        # the stiffness of each contact is a power of its force
        unit = contact.stiffness(1.0)
        exponent = math.log2(contact.stiffness(2.0) / unit)
        preload = (seat_stiffness / unit) ** (1.0 / exponent)
        seated = replace(drive, seats=(contact,), preload=Preload(force=preload))
        force = _pushed(seated, k_in, 0.5 * drive.stroke)
        rates[name] = added.frequency_hz(seated.tangent(preload + force))
    return rates


def _pushed(drive: Drive, k_in: float, displacement: float) -> float:
    """Return the force of a drive on a spring, F/k + c(F) = w, by Newton's method."""
    preload = drive.preload.force if drive.preload else 0.0
    force, step = 0.0, math.inf
    # contacts stiffen, so that each step ends below the root
    while step > _SETTLED * force:
        left = displacement - force / k_in - drive.compression(force)
        step = left / (1.0 / k_in + 1.0 / (drive.tangent(preload + force) or math.inf))
        force += step
    return force
