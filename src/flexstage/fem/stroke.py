"""A stage over the whole stroke of a drive: straightness, stiffening, buckling."""

from dataclasses import dataclass, replace

import numpy as np

from flexstage import progress
from flexstage.arrays import Array
from flexstage.characteristic import Characteristic, Characteristics
from flexstage.elasticity.buckling import buckling
from flexstage.elasticity.large_displacement import follow_drive
from flexstage.elasticity.loaded import stress_stiffening
from flexstage.errors import ConvergenceError, ModelError
from flexstage.fem.geometry import patches
from flexstage.fem.model import StageModel, UncoupledProblem
from flexstage.fem.ports import Supports, body_motion, drive_vector
from flexstage.quantities import QUANTITIES
from flexstage.short_repr import short_repr
from flexstage.system import Analysis, AxisAnalysis
from flexstage.system.analysis import axis_mode

_STEPS = 7


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FiniteStroke:
    """Motion of a platform over the stroke of a drive, with finite displacements."""

    axis: str
    """Name of the axis."""
    displacement: Array
    """Elongation of the drive, from nothing to the stroke [m], shape (k,)."""
    force: Array
    """Force that it takes [N], shape (k,)."""
    along: Array
    """Motion of the platform along the axis [m], shape (k,)."""
    across: Array
    """Its motion to the left of it [m], shape (k,)."""
    rotation: Array
    """Its rotation [rad], shape (k,)."""
    frequency_hz: float
    """Natural frequency of the axis' mode at full stroke, drives removed [Hz]."""
    buckling_factor: float
    """Smallest factor of the load of the full stroke at which the stage buckles, the drive held at
    its length [1]; infinite where it does not.
    """

    __repr__ = short_repr

    @property
    def deviation(self) -> Array:
        """Distance of the path from its least-squares straight line [m], shape (k,)."""
        design = np.stack((np.ones_like(self.along), self.along), axis=1)
        fit, *_ = np.linalg.lstsq(design, self.across, rcond=None)
        return (self.across - design @ fit) / np.hypot(1.0, fit[1])

    @property
    def straightness(self) -> float:
        """Largest less smallest deviation from the least-squares straight line [m]."""
        return float(np.ptp(self.deviation))

    @property
    def ratio_change(self) -> float:
        """Mean ratio over the stroke against the ratio at its beginning, less one [1]."""
        whole = self.along[-1] / self.displacement[-1]
        first = self.along[1] / self.displacement[1]
        # a parabola through rest, the first step and the last gives the slope at rest
        share_of = self.displacement[1] / self.displacement[-1]
        slope = (first - share_of * whole) / (1.0 - share_of)
        return float(whole / slope - 1.0)


def follow_stroke(model: StageModel, axis: AxisAnalysis, *, steps: int = _STEPS) -> FiniteStroke:
    """Follow a stage over the stroke of one of its drives, the others removed.

    Parameters
    ----------
    model : StageModel
        A finite-element model of the stage.
    axis : AxisAnalysis
        The axis, as analysed with small displacements.
    steps : int
        States along the stroke, at least 3.

    Returns
    -------
    FiniteStroke
        The path, and natural frequency and buckling at its end.

    Raises
    ------
    ModelError
        There are too few steps.
    ConvergenceError
        No equilibrium was found.

    Notes
    -----
    Validity: any rotation, small strains; the drive keeps its direction. Motion out of the plane,
    which comes from errors of manufacture, is not in it.
    """
    if steps < 3:
        raise ModelError(f"a stroke is followed in at least 3 steps, got {steps}")
    stage, problem = model.stage, model.problems[0]
    continuum = problem.continuum
    row = _drive_row(model, axis.drive)
    probe = stage.probe(axis.probe)
    platform = body_motion(continuum, stage, probe.body, probe.at)
    if probe.relative_to is not None:
        platform = platform - body_motion(continuum, stage, probe.relative_to, probe.at)
    values = np.linspace(0.0, axis.input_displacement, steps)[1:]
    with progress.subtask(0.0, 0.7):
        progress.update("large displacement")
        path = follow_drive(continuum, row, values)
    moved = np.concatenate((np.zeros((1, 3)), path.displacement @ platform.T))
    c, s = np.cos(probe.direction), np.sin(probe.direction)
    progress.update("stiffening", 0.7)
    frequency = _frequency_at(model, problem, axis, path.displacement[-1])
    progress.update("buckling", 0.85)
    found = buckling(continuum, problem.basis @ axis.static.q, locked=row)
    factor = float(found.positive[0]) if found.positive.size else np.inf
    continuum.release()
    return FiniteStroke(
        axis=axis.axis,
        displacement=np.concatenate(([0.0], path.values)),
        force=np.concatenate(([0.0], path.force)),
        along=c * moved[:, 0] + s * moved[:, 1],
        across=c * moved[:, 1] - s * moved[:, 0],
        rotation=moved[:, 2],
        frequency_hz=frequency,
        buckling_factor=factor,
    )


def _drive_row(model: StageModel, name: str) -> Array:
    stage = model.stage
    drive = stage.drive(name)
    supports: Supports = "elastic" if model.system.settings["supports"] == "elastic" else "rigid"
    touched = patches(drive, stage.bodies)
    return drive_vector(model.problems[0].continuum, stage, drive, touched, supports)


def _frequency_at(
    model: StageModel, problem: UncoupledProblem, axis: AxisAnalysis, u: Array
) -> float:
    """Frequency of the mode at a loaded state that moves the axis most."""
    stage = model.stage
    probe = stage.probe(axis.probe)
    drive = _drive_row(model, axis.drive)
    motion = body_motion(problem.continuum, stage, probe.body, probe.at)
    read = np.cos(probe.direction) * motion[0] + np.sin(probe.direction) * motion[1]
    omega, shapes = stress_stiffening(problem.continuum, u, 4)
    gain = np.abs((read @ shapes) * (drive @ shapes)) / omega**2
    return float(omega[int(np.argmax(gain))] / (2.0 * np.pi))


def with_stroke(analysis: Analysis, model: StageModel) -> tuple[Analysis, tuple[FiniteStroke, ...]]:
    """Add what finite displacements say to an analysis: straightness and buckling of each axis.

    The model is in its plane.
    """
    rows = list(analysis.characteristics)
    validity = list(analysis.validity)
    paths: list[FiniteStroke] = []
    for k, axis in enumerate(analysis.axes):
        try:
            with progress.subtask(k / len(analysis.axes), (k + 1) / len(analysis.axes)):
                path = follow_stroke(model, axis)
        except ConvergenceError as error:
            validity.append(f"Axis {axis.axis} could not be followed over its stroke: {error}.")
            continue
        paths.append(path)
        last = max(i for i, row in enumerate(rows) if row.axis == axis.axis)
        rows[last + 1 : last + 1] = _rows(analysis, path)
        validity.append(_said(analysis, axis, path))
    return (
        replace(analysis, characteristics=Characteristics(rows), validity=tuple(validity)),
        tuple(paths),
    )


def _rows(analysis: Analysis, path: FiniteStroke) -> list[Characteristic]:
    found: list[tuple[str, float, str]] = [
        (
            "straightness",
            path.straightness,
            "finite displacements over the full stroke: largest less smallest distance from the "
            "least-squares straight line",
        )
    ]
    if path.buckling_factor < np.inf:
        found.append(
            (
                "buckling_factor",
                path.buckling_factor,
                "in-plane buckling load over the load at full stroke",
            )
        )
    return [
        Characteristic(
            quantity=quantity,
            axis=path.axis,
            origin=analysis.system.model,
            value=value,
            unit=QUANTITIES[quantity].unit,
            note=note,
        )
        for quantity, value, note in found
    ]


def _said(analysis: Analysis, axis: AxisAnalysis, path: FiniteStroke) -> str:
    bare = analysis.modes["removed"]
    mode = axis_mode(analysis.system, bare, axis.drive, axis.probe)
    rise = path.frequency_hz / bare.frequency_hz[mode] - 1.0
    stiffer = (path.force[-1] / path.displacement[-1]) / axis.input_stiffness - 1.0
    return (
        f"Over the full stroke of {axis.axis}, with finite displacements: the ratio changes by "
        f"{_percent(path.ratio_change)}, the force differs by {_percent(stiffer)} from the linear "
        f"one, and the natural frequency of the axis changes by {_percent(rise)}."
    )


def _percent(share_of: float) -> str:
    return f"{100.0 * share_of:+.2f} %".replace("-", "−")
