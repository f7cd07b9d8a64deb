"""Path of a manufactured stage over its stroke, by its own model."""

import math
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
from numpy.polynomial import Legendre

from flexstage.base.arrays import Array
from flexstage.base.errors import ConvergenceError, ModelError
from flexstage.lumped import mechanism, stroke_path
from flexstage.lumped.rigid_bodies import Mechanism
from flexstage.stage import Axis, Stage
from flexstage.system.statics import StrokeMotion
from flexstage.virtual.imperfections import ORDER, GuideErrors, Scatter
from flexstage.virtual.scattered_motion import Deviations, drive_of, motion_rates

#: States along a stroke.
_STATES = 11


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ModelPath:
    """Path of an axis of a manufactured stage over its stroke."""

    model: str
    """Model of the nominal path: ``plane`` or ``lumped``."""
    stroke: float
    """Travel along the axis [m]."""
    curves: Mapping[str, Legendre]
    """Motion across and yaw over the position, from 0 to the stroke [m, rad]."""
    slopes: Mapping[str, float]
    """Out-of-plane motion per metre of travel, by scatter: vertical [1], roll and pitch [rad/m]."""

    def over(self, guide: GuideErrors) -> GuideErrors:
        """Return the error motions of a guide with those of this path in place of assumed ones.

        The vertical straightness remains, as no model in the plane has one.
        """
        coefficients = dict(guide.coefficients)
        for motion, curve in self.curves.items():
            converted = curve.convert(domain=[0.0, guide.stroke]).coef
            coefficients[motion] = np.asarray(converted, dtype=np.float64)
        for motion, slope in self.slopes.items():
            bow = coefficients[motion] * (motion == "vertical")
            bow[1] = 0.5 * slope * guide.stroke
            coefficients[motion] = bow
        return replace(guide, coefficients=coefficients)


def model_paths(
    stage: Stage,
    specimen: Stage,
    moved: Mapping[str, tuple[float, float]],
    inputs: Mapping[str, float],
    scatter: Scatter,
    *,
    seed: int,
    nominal: Mapping[str, StrokeMotion] | None = None,
) -> dict[str, ModelPath]:
    r"""Return the paths of the axes of a manufactured stage.

    The path in the plane is that of rigid bodies and leaves with finite rotations, with the necks
    of the specimen where they are. Of finite elements, it is

    .. math:: v(u) = v_{elements}(u) + v_{specimen}(u) - v_{drawing}(u)

    with the last two by rigid bodies, to all orders of the travel. Out of the plane, notches that
    lean and drives off their line turn and lift the platform in proportion to the travel
    (`flexstage.virtual.scattered_motion`).

    Parameters
    ----------
    stage, specimen : Stage
        The stage as drawn and as manufactured.
    moved : mapping
        Position error of each notch along x and y, by hinge [m].
    inputs : mapping
        Stroke of the drive of each axis to follow [m].
    scatter : Scatter
        The process, for the lean of notches and the line of action of drives.
    seed : int
        Seed of both.
    nominal : mapping, optional
        Path of axes as drawn, by finite elements.

    Returns
    -------
    dict of str to ModelPath
        By axis, without those that no model follows: rotations, and axes with several drives.

    Notes
    -----
    Validity: rigid bodies in the effect of the scatter; see `stroke_path` and `motion_rates`.
    """
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(9,)))
    position = np.array([moved.get(h.name, (0.0, 0.0)) for h in stage.hinges]).reshape(-1, 2)
    necks = [
        hinge.profile.neck_thickness - nominal_hinge.profile.neck_thickness
        for hinge, nominal_hinge in zip(specimen.hinges, stage.hinges, strict=True)
    ]
    deviations = Deviations(
        neck=np.array([necks]),
        position=position[None],
        lean=scatter.lean * rng.standard_normal((1, len(stage.hinges), 2)),
        drive=scatter.drive * rng.standard_normal((1, len(stage.drives), 2)),
    )
    nominal_model = mechanism(stage)
    model = _displaced(mechanism(specimen), position, deviations.drive[0, :, 0])
    paths = {}
    for axis in (a for a in stage.axes if a.name in inputs):
        # an axis that cannot be followed has no path
        with suppress(ConvergenceError, ModelError):
            elements = (nominal or {}).get(axis.name)
            path = _in_plane(
                axis, inputs[axis.name], nominal_model, model, elements, _side(stage, axis)
            )
            rates = motion_rates(replace(stage, axes=(axis,)), deviations)[axis.name][0]
            slopes = dict(zip(("vertical", "roll", "pitch"), rates[2:5].tolist(), strict=True))
            paths[axis.name] = replace(path, slopes=slopes)
    return paths


def _displaced(model: Mechanism, position: Array, off: Array) -> Mechanism:
    """Move the necks by x and y, and the lines of the drives to their left [m]."""
    drives = []
    for drive, left in zip(model.drives, off.tolist(), strict=True):
        angle = drive.direction or 0.0
        aside = (-left * math.sin(angle), left * math.cos(angle))
        start, end = ((x + aside[0], y + aside[1]) for x, y in drive.points)
        drives.append(replace(drive, points=(start, end)))
    hinges = tuple(
        replace(hinge, at=(hinge.at[0] + dx, hinge.at[1] + dy))
        for hinge, (dx, dy) in zip(model.hinges, position.tolist(), strict=True)
    )
    return replace(model, hinges=hinges, drives=tuple(drives))


def _side(stage: Stage, axis: Axis) -> float:
    """Return 1 if the other axis is to the left of an axis, -1 if it is to its right."""
    directions = [stage.probe(a.probe).direction for a in stage.axes if a.name != axis.name]
    direction = stage.probe(axis.probe).direction
    if direction is None or not directions or directions[0] is None:
        return 1.0
    return math.copysign(1.0, math.sin(directions[0] - direction))


def _in_plane(
    axis: Axis,
    travel: float,
    nominal: Mechanism,
    model: Mechanism,
    elements: StrokeMotion | None,
    side: float,
) -> ModelPath:
    steps = np.linspace(0.0, travel, _STATES)
    parts: list[tuple[float, StrokeMotion]] = [
        (1.0, stroke_path(model, drive_of(axis), axis.probe, steps))
    ]
    if elements is not None:
        parts += [(-1.0, stroke_path(nominal, drive_of(axis), axis.probe, steps)), (1.0, elements)]
    stroke = sum(sign * float(part.along[-1]) for sign, part in parts)

    def curve(name: str, scale: float) -> Legendre:
        total = Legendre(np.zeros(ORDER + 1), domain=[0.0, stroke])
        for sign, part in parts:
            values = sign * scale * getattr(part, name)
            total += Legendre.fit(part.along, values, ORDER, domain=[0.0, stroke])
        return total

    return ModelPath(
        model="lumped" if elements is None else "plane",
        stroke=stroke,
        curves={"across": curve("across", side), "yaw": curve("rotation", 1.0)},
        slopes={},
    )
