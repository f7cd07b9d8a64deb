r"""What a sensor and its place add to the uncertainty of a figure that was read with it.

The measurement models, with the reading r, relative error c of the calibration, angle a between
sensor and axis, distance d from the sensor's line to the point of interest (Abbe), pitch p over the
same stroke, thermal path of length l and expansion alpha that changes its temperature by T, rate
of drift w left over a duration t, deviation n from a straight line, and step q of the reading:

==================  =================================================================
role                measurement model
==================  =================================================================
length              :math:`r(1+c)/\cos a - d\,p - \alpha l T - w t + n + q`
transverse range    :math:`r(1+c) + n + q`: a tilt of sensor or artefact is a slope,
                    and the line that is taken out of the record takes it too
coupling            :math:`r(1+c_1)/(1+c_2) + a`: two sensors, each with its gain
squareness          as coupling, in rad
angle               :math:`r(1+c)/\cos a + n + q`, of a sensor of angle
area                :math:`r(1+c_1)(1+c_2)/(\cos a_1\cos a_2)`: two sensors
frequency           :math:`r(1+b)` with the relative error b of the time base
drift               :math:`r(1+c) - w`
noise               :math:`r(1+c)`
==================  =================================================================

All errors have the expectation 0 but that of the angle: :math:`k = 1 - \cos a` lies on one side,
and for a normal angle of standard uncertainty s has exactly the mean :math:`1 - e^{-s^2/2}` and the
standard deviation :math:`(1 - e^{-s^2})/\sqrt2`.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Literal, get_args

from flexstage.base.errors import ModelError
from flexstage.measure.uncertainty.propagate import Influence, influence_from, propagate
from flexstage.quantities.estimate import Component, Estimate
from flexstage.quantities.sensor import SensorSpecification

Role = Literal[
    "length",
    "transverse range",
    "coupling",
    "squareness",
    "angle",
    "area",
    "frequency",
    "drift",
    "noise",
]

#: What a figure can be to the sensor.
ROLES: tuple[Role, ...] = get_args(Role)


def measured(
    raw: Estimate,
    sensor: SensorSpecification | None,
    *,
    role: Role,
    pitch: Estimate | None = None,
    duration: float = 0.0,
    span: float | None = None,
) -> Estimate:
    r"""Return a figure with the uncertainty of its sensor, by the measurement model of its role.

    First order by `propagate`, as in JCGM 100:2008, 5.1. The contributions of the raw figure are
    kept, times its sensitivity; those of the sensor come by name after them: ``calibration``,
    ``nonlinearity``, ``alignment``, ``Abbe``, ``temperature``, ``drift``, ``resolution`` and
    ``time base``, each that is not nothing.

    Parameters
    ----------
    raw : Estimate
        The figure as it was read, with the uncertainty that its scatter gives it.
    sensor : SensorSpecification or None
        The sensor; None leaves the figure as it is.
    role : str
        One of `ROLES`: what the figure is.
    pitch : Estimate, optional
        Rotation over the same stroke, about the axis that the Abbe offset is normal to [rad], for
        the role ``length``.
    duration : float
        Time between the readings that the figure compares [s].
    span : float, optional
        Range over which the sensor was used [unit of `raw`]; the value itself where not given.

    Returns
    -------
    Estimate
        The figure, corrected for the mean cosine error and for the Abbe error of the given pitch.

    Raises
    ------
    ModelError
        The role is unknown, or a figure is impossible.

    Notes
    -----
    Validity: first order in all but the angle and the Abbe error; small angles, below some 0.1 rad.
    The deviation from a line is taken as independent at the two ends of a length, each uniform, and
    so is the rounding of their readings. Where no pitch is given, an Abbe offset adds nothing, as
    it is not known. The angle's error has one sign, and where it outweighs all others the interval
    is still symmetric: it then covers 94.8 %, but too much below and too little above.

    Examples
    --------
    >>> noise = Component(name="noise", uncertainty=3e-9, degrees_of_freedom=9)
    >>> read = Estimate(value=63e-6, unit="m", components=(noise,))
    >>> full = measured(read, SensorSpecification(calibration=2e-4, alignment=0.01), role="length")
    >>> [f"{c.name} {c.uncertainty * 1e9:.2f} nm" for c in full.components]
    ['noise 3.00 nm', 'calibration 12.60 nm', 'alignment 4.45 nm']
    """
    if sensor is None:
        return raw
    if role not in ROLES:
        raise ModelError(f"unknown role {role!r} of a figure: expected one of {', '.join(ROLES)}")
    if not 0.0 <= duration < math.inf:
        raise ModelError(f"a duration must be 0 or more and finite, got {duration!r} s")
    reading = influence_from(replace(raw, bounds=None), "reading")
    model = _Model(raw, sensor, pitch, duration, abs(raw.value) if span is None else abs(span))
    errors, function = getattr(model, _MODELS.get(role, role))()
    # what is exactly known adds no line
    propagated = propagate(lambda r, *e: function(r, e), (reading, *(i for _, i in errors)))
    reading_line, *others = propagated.lines
    scaled = raw.times(reading_line.sensitivity)
    more: dict[str, list[Component]] = {}
    for (name, _), line in zip(errors, others, strict=True):
        part = Component(
            name=name,
            uncertainty=line.contribution,
            degrees_of_freedom=line.degrees_of_freedom,
            kind=line.kind,
        )
        more.setdefault(name, []).append(part)
    merged = [_merged(name, parts) for name, parts in more.items()]
    shift = propagated.value - scaled.value
    ends = None if scaled.bounds is None else (scaled.bounds[0] + shift, scaled.bounds[1] + shift)
    moved = replace(scaled, value=propagated.value, bounds=ends)
    return moved.plus(*(c for c in merged if c.uncertainty > 0.0))


_Errors = list[tuple[str, Influence]]
_Function = Callable[[Any, Any], Any]

#: The model of a role, where it is not called like it.
_MODELS = {"transverse range": "transverse", "coupling": "ratio", "squareness": "ratio"}


@dataclass(frozen=True, slots=True)
class _Model:
    """Measurement models: the errors by name, and the figure from its reading and their values."""

    raw: Estimate
    sensor: SensorSpecification
    pitch: Estimate | None
    duration: float
    span: float

    def length(self) -> tuple[_Errors, _Function]:
        s = self.sensor
        errors = [
            _error("calibration", s.calibration),
            _cosine(s.alignment),
            *self.ends(),
            _error("temperature", s.expansion * s.length_of_loop * s.temperature_uncertainty),
            _error("drift", s.drift * self.duration),
        ]

        def level(r: Any, e: Any) -> Any:
            return r * (1 + e[0]) / (1 - e[1]) + e[2] + e[3] - e[4] - e[5]

        if self.pitch is None:
            return errors, level
        offset = Influence(name="offset", value=s.abbe_offset, uncertainty=s.abbe_uncertainty)
        turned = influence_from(self.pitch, "pitch")
        # of a product of independent factors this term is exact, and all there is where both are 0
        both = s.abbe_uncertainty * self.pitch.uncertainty
        errors += [("Abbe", offset), ("Abbe", turned), _error("Abbe", both, " of both")]
        return errors, lambda r, e: level(r, e) - e[6] * e[7] - e[8]

    def transverse(self) -> tuple[_Errors, _Function]:
        errors = [_error("calibration", self.sensor.calibration), *self.ends()]
        return errors, lambda r, e: r * (1 + e[0]) + e[1] + e[2]

    def ratio(self) -> tuple[_Errors, _Function]:
        s = self.sensor
        gains = [_error("calibration", s.calibration, str(n)) for n in (1, 2)]
        return [
            *gains,
            _error("alignment", s.alignment),
        ], lambda r, e: r * (1 + e[0]) / (1 + e[1]) + e[2]

    def angle(self) -> tuple[_Errors, _Function]:
        s = self.sensor
        errors = [_error("calibration", s.calibration), _cosine(s.alignment), *self.ends()]
        return errors, lambda r, e: r * (1 + e[0]) / (1 - e[1]) + e[2] + e[3]

    def area(self) -> tuple[_Errors, _Function]:
        s = self.sensor
        errors = [_error("calibration", s.calibration, str(n)) for n in (1, 2)]
        errors += [_cosine(s.alignment, str(n)) for n in (1, 2)]
        return errors, lambda r, e: r * (1 + e[0]) * (1 + e[1]) / ((1 - e[2]) * (1 - e[3]))

    def frequency(self) -> tuple[_Errors, _Function]:
        return [_error("time base", self.sensor.time_base)], lambda r, e: r * (1 + e[0])

    def drift(self) -> tuple[_Errors, _Function]:
        errors = [
            _error("calibration", self.sensor.calibration),
            _error("drift", self.sensor.drift),
        ]
        return errors, lambda r, e: r * (1 + e[0]) - e[1]

    def noise(self) -> tuple[_Errors, _Function]:
        return [_error("calibration", self.sensor.calibration)], lambda r, e: r * (1 + e[0])

    def ends(self) -> _Errors:
        """Nonlinearity and rounding, each of two independent readings with uniform errors."""
        s = self.sensor
        return [
            _error("nonlinearity", math.sqrt(2.0 / 3.0) * s.nonlinearity * self.span),
            _error("resolution", s.resolution_step / math.sqrt(6.0)),
        ]


def _error(name: str, uncertainty: float, which: str = "") -> tuple[str, Influence]:
    return name, Influence(name=name + which, value=0.0, uncertainty=abs(uncertainty))


def _cosine(alignment: float, which: str = "") -> tuple[str, Influence]:
    """1 - cos a of a normal angle: its exact mean and standard deviation."""
    return "alignment", Influence(
        name="alignment" + which,
        value=-math.expm1(-0.5 * alignment**2),
        uncertainty=-math.expm1(-(alignment**2)) / math.sqrt(2.0),
    )


def _merged(name: str, parts: list[Component]) -> Component:
    combined = Estimate(value=0.0, unit="", components=tuple(parts))
    return Component(
        name=name,
        uncertainty=combined.uncertainty,
        degrees_of_freedom=combined.degrees_of_freedom,
        kind="A" if any(p.kind == "A" and p.uncertainty > 0.0 for p in parts) else "B",
    )
