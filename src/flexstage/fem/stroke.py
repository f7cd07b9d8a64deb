"""Motion of a stage over the stroke of a drive: straightness, stiffening, buckling."""

import math
from dataclasses import dataclass, replace

import numpy as np

from flexstage.base import progress
from flexstage.base.arrays import Array
from flexstage.base.errors import ConvergenceError, ModelError
from flexstage.elasticity.loaded import buckling, follow_drive, stress_stiffening
from flexstage.fem.geometry import patches
from flexstage.fem.mesh import MeshSettings
from flexstage.fem.model import StageModel, UncoupledProblem
from flexstage.fem.stage_system import Supports, body_motion, body_path, drive_vector
from flexstage.fem.whole_stage import plane_model
from flexstage.quantities.characteristic import Characteristic, Characteristics
from flexstage.quantities.quantity import QUANTITIES
from flexstage.stage import Body, Force, Hinge, Loop, Stage
from flexstage.system import Analysis, AxisAnalysis
from flexstage.system.characteristics import axis_mode
from flexstage.system.statics import StrokeMotion

_STEPS = 7


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class FiniteStroke(StrokeMotion):
    """Motion of a platform over the stroke of a drive, from zero, with finite displacements."""

    axis: str
    """Name of the axis."""
    force: Array
    """Force of the drive [N], shape (k,)."""
    frequency_hz: float
    """Natural frequency of the axis' mode at full stroke, drives removed [Hz]."""
    buckling_factor: float
    """Smallest factor of the load of the full stroke at which the stage buckles with the drive
    locked [1]; infinite where it does not.
    """

    @property
    def ratio_change(self) -> float:
        """Mean ratio over the stroke against the ratio at its beginning, less one [1]."""
        full = self.along[-1] / self.displacement[-1]
        first = self.along[1] / self.displacement[1]
        # a parabola through rest, the first step and the last gives the slope at rest
        share_of = self.displacement[1] / self.displacement[-1]
        slope = (first - share_of * full) / (1.0 - share_of)
        return float(full / slope - 1.0)


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
    by manufacturing errors, is not included.
    """
    if steps < 3:
        raise ModelError(f"a stroke is followed in at least 3 steps, got {steps}")
    stage, problem = model.stage, model.problems[0]
    continuum = problem.continuum
    row = _drive_row(model, axis.drive)
    probe = stage.probe(axis.probe)
    values = np.linspace(0.0, axis.input_displacement, steps)[1:]
    with progress.subtask(0.0, 0.7):
        progress.update("large displacement")
        path = follow_drive(continuum, row, values)
    u = np.concatenate((np.zeros((1, continuum.size)), path.displacement))
    moved = body_path(continuum, stage, probe.body, probe.at, u)
    if probe.relative_to is not None:
        moved = moved - body_path(continuum, stage, probe.relative_to, probe.at, u)
    c, s = probe.along
    progress.update("stiffening", 0.7)
    frequency = _frequency_at(model, problem, axis, path.displacement[-1])
    progress.update("buckling", 0.85)
    factors = buckling(continuum, problem.basis @ axis.static.q, locked=row)
    factor = float(factors.positive[0]) if factors.positive.size else np.inf
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
    """Return the frequency of the mode at a loaded state that moves the axis most."""
    stage = model.stage
    probe = stage.probe(axis.probe)
    drive = _drive_row(model, axis.drive)
    motion = body_motion(problem.continuum, stage, probe.body, probe.at)
    read = np.array(probe.row) @ motion
    omega, shapes = stress_stiffening(problem.continuum, u, 4)
    gain = np.abs((read @ shapes) * (drive @ shapes)) / omega**2
    return float(omega[int(np.argmax(gain))] / (2.0 * np.pi))


def with_stroke(analysis: Analysis, model: StageModel) -> tuple[Analysis, tuple[FiniteStroke, ...]]:
    """Add straightness and buckling of each axis, by finite displacements, to an analysis.

    The model is in its plane.
    """
    rows = list(analysis.characteristics)
    validity = list(analysis.validity)
    paths: list[FiniteStroke] = []
    for k, axis in enumerate(analysis.axes):
        if len(axis.drives) > 1 or model.stage.probe(axis.probe).direction is None:
            validity.append(
                f"Axis {axis.axis} was not followed over its stroke: this requires a single drive "
                "and a probe of displacement."
            )
            continue
        try:
            with progress.subtask(k / len(analysis.axes), (k + 1) / len(analysis.axes)):
                path = follow_stroke(model, axis)
        except ConvergenceError as error:
            validity.append(f"Axis {axis.axis} could not be followed over its stroke: {error}.")
            continue
        paths.append(path)
        last = max(i for i, row in enumerate(rows) if row.axis == axis.axis)
        rows[last + 1 : last + 1] = _rows(analysis, path)
        validity.append(_stroke_note(analysis, axis, path))
    return (
        replace(analysis, characteristics=Characteristics(rows), validity=tuple(validity)),
        tuple(paths),
    )


def _rows(analysis: Analysis, path: FiniteStroke) -> list[Characteristic]:
    figures: list[tuple[str, float, str]] = [
        (
            "straightness",
            path.straightness,
            "finite displacements over the full stroke: largest less smallest distance from the "
            "least-squares straight line",
        )
    ]
    if path.buckling_factor < np.inf:
        figures.append(
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
        for quantity, value, note in figures
    ]


def _stroke_note(analysis: Analysis, axis: AxisAnalysis, path: FiniteStroke) -> str:
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


Point = tuple[float, float]


def two_notch_bars(stage: Stage) -> tuple[str, ...]:
    """Return the bodies that are bars between two notches on one line.

    They are guide legs and links.
    """
    bars = []
    for body in stage.bodies:
        hinges = [h for h in stage.hinges if body.name in h.bodies]
        pushed = any(body.name in (d.pushes, d.reacts) for d in stage.drives)
        if len(hinges) != 2 or body.fixed or pushed:
            continue
        (x0, y0), (x1, y1) = hinges[0].at, hinges[1].at
        line = np.array([x1 - x0, y1 - y0])
        length = float(np.hypot(*line))
        if length == 0.0:
            continue
        turned = [
            abs(line[0] * np.sin(h.direction) - line[1] * np.cos(h.direction)) for h in hinges
        ]
        if max(turned) < 1e-6 * length:
            bars.append(body.name)
    return tuple(bars)


def bar_buckling_load(stage: Stage, body: str, settings: MeshSettings | None = None) -> float:
    """Return the axial force at which a bar between two notches loses its resistance to sway.

    Two such bars side by side, far apart, carry a block that can move sideways but hardly turn, as
    a platform between its legs can; the block is pressed down until they buckle. Half of that is
    the load of one bar. By a rigid bar of length L between two hinges of stiffness k it would be
    2 k/L.

    `body` is one of `two_notch_bars`, the load in N; the mesh is of order 4 with elements of 0.8
    necks where not given.

    Notes
    -----
    Validity: bifurcation of a straight bar in the plane; crookedness and eccentric load reduce the
    load of a real one, and the necks may yield before.
    """
    if body not in two_notch_bars(stage):
        raise ModelError(
            f"body '{body}' is not a bar between two notches on one line; such bars are: "
            f"{', '.join(two_notch_bars(stage)) or 'none'}"
        )
    model = plane_model(_two_bar_rig(stage, body), settings, modes=1)
    problem = model.problems[0]
    drive = model.system.drive("press")
    u = problem.basis @ np.linalg.solve(model.system.K, drive.vector)
    factors = buckling(problem.continuum, u)
    if not factors.positive.size:
        raise ModelError(f"the bar '{body}' does not buckle under an axial load")
    return 0.5 * float(factors.positive[0])


def _two_bar_rig(stage: Stage, name: str) -> Stage:
    """Return a rig of two equal bars between a fixed block and one that is pressed towards it."""
    first, second = (h for h in stage.hinges if name in h.bodies)
    x0, y0 = first.at
    along = math.atan2(second.at[1] - y0, second.at[0] - x0)
    length = math.dist(first.at, second.at)
    reach = [h.profile.length / 2.0 for h in (first, second)]
    high = max(h.profile.root_height for h in (first, second))
    apart = 4.0 * (length + high)
    c, s = math.cos(along), math.sin(along)

    def turned(p: Point) -> Point:
        """Map a point from axes along the bar, with the first neck as origin."""
        return (x0 + c * p[0] - s * p[1], y0 + s * p[0] + c * p[1])

    def block(low: float, top: float) -> Loop:
        wide = apart / 2.0 + 2.0 * high
        return Loop(
            tuple(turned(p) for p in ((low, -wide), (top, -wide), (top, wide), (low, wide)))
        )

    thick = apart / 2.0
    ground = Body(name="ground", outline=block(-reach[0] - thick, -reach[0]), fixed=True)
    top = length + reach[1]
    slider = Body(name="slider", outline=block(top, top + thick))
    bars, hinges = [], []
    for k, side in enumerate((-0.5, 0.5)):
        dx, dy = -s * side * apart, c * side * apart

        def aside(p: Point, dx: float = dx, dy: float = dy) -> Point:
            return (p[0] + dx, p[1] + dy)

        bar = stage.body(name)
        holes = tuple(
            h.mapped(aside) if isinstance(h, Loop) else replace(h, centre=aside(h.centre))
            for h in (*bar.holes, *bar.mounting_holes)
        )
        bars.append(
            Body(
                name=f"bar {k}",
                outline=bar.outline.mapped(aside),
                holes=holes,
                material=bar.material,
                rigid=bar.rigid,
            )
        )
        for hinge, end in ((first, "ground"), (second, "slider")):
            joined = tuple(f"bar {k}" if b == name else end for b in hinge.bodies)
            hinges.append(
                Hinge(
                    name=f"{end} {k}",
                    bodies=(joined[0], joined[1]),
                    at=aside(hinge.at),
                    direction=hinge.direction,
                    profile=hinge.profile,
                )
            )
    press = Force(
        name="press",
        pushes="slider",
        reacts="ground",
        at=(turned((top + thick, 0.0)), turned((-reach[0] - thick, 0.0))),
        direction=along + math.pi,
        patch_half_width=apart / 2.0,
        largest_force=1.0,
    )
    return Stage(
        name=f"{stage.name} {name}",
        thickness=stage.thickness,
        material=stage.material,
        bodies=(ground, slider, *bars),
        hinges=tuple(hinges),
        drives=(press,),
    )
