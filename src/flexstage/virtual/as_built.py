"""A virtual stage as manufactured: its true behaviour, its published figures and their origins.

The true values are unknown to any measurement. A usual figure replaces one that is not published.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexstage.base.arrays import Array
from flexstage.base.choose import has_no
from flexstage.base.errors import ModelError
from flexstage.hysteresis.loops import loop_width
from flexstage.hysteresis.model import HysteresisModel
from flexstage.lumped import hinge_springs
from flexstage.lumped.assemble import hinge_matrix, layout_of
from flexstage.measure.update_parameters import UpdateParameter
from flexstage.measure.updating import update_stage
from flexstage.quantities.characteristic import Characteristics, measured_value
from flexstage.quantities.estimate import Component, Estimate
from flexstage.stage import PiezoStack, Stage
from flexstage.stage.assumptions import (
    DIRECTION_SPREAD,
    GUIDE_LENGTH,
    LOOP_WIDTH,
    REPEATABILITY,
    REVERSAL,
    STRAIGHTNESS,
    VIRTUAL_DAMPING_RATIO,
)
from flexstage.system import AxisAnalysis, MechanicalSystem, ModalDamping, analyse, modes
from flexstage.system.characteristics import axis_mode
from flexstage.system.statics import StrokeMotion
from flexstage.virtual.imperfections import (
    GuideErrors,
    Scatter,
    displaced_system,
    displacements,
    manufactured,
    random_guide,
)
from flexstage.virtual.model_path import ModelPath, model_paths
from flexstage.virtual.neck_widths import NeckWidths
from flexstage.virtual.stack import FINE_PLAYS, virtual_stack

#: Samples of a conditioning cycle.
_SETTLING = 100


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class AsBuiltAxis:
    """True behaviour of one axis."""

    name: str
    """Name of the axis."""
    command_range: tuple[float, float]
    """Range of the command: voltage [V] of a piezo stack, elongation [m] of a screw."""
    command_unit: str
    """Unit of the command."""
    guide: GuideErrors
    """Error motions, and the position error along the axis."""
    hysteresis: HysteresisModel | None
    """Hysteresis from command to position; None for a drive without it."""
    reversal: float
    """Reversal error in the middle of the stroke, of a drive without hysteresis [m]."""
    repeatability: float
    """Standard deviation of the position from cycle to cycle [m]."""
    mode: int
    """Index of the mode along the axis."""
    smallest_step: float | None
    """Smallest step of the position [m]; None for a continuous drive."""
    low_end: float = 0.0
    """Output of the hysteresis at the low end of the stroke [m], the zero of positions."""

    @property
    def stroke(self) -> float:
        """Length of the stroke [m]."""
        return self.guide.stroke

    def position(self, command: ArrayLike) -> Array:
        """Return the position from the low end [m] for commands [V, or m], after two full cycles.

        Repeatability is not included.
        """
        u = np.asarray(command, dtype=np.float64)
        low, high = self.command_range
        if self.hysteresis is None:
            p = (u - low) / (high - low) * self.stroke
            # a loop closed at both ends and widest in the middle
            half = np.where(_falling(u), 0.5, -0.5) * self.reversal
            loop = 4.0 * half * (p / self.stroke) * (1.0 - p / self.stroke)
            return p + self.guide.at(p, "along") + loop
        before = np.concatenate([self.cycle(_SETTLING)] * 2)
        output = self.hysteresis.simulate(np.concatenate((before, u))).values[before.size :]
        return output - self.low_end

    def cycle(self, samples: int) -> Array:
        """Return one triangular cycle of commands over the full range, from the low end."""
        low, high = self.command_range
        t = np.arange(samples) / samples
        return low + (high - low) * (1.0 - np.abs(2.0 * t - 1.0))

    def loop_width(self) -> float:
        """Return the true width of the loop of position over command [m]."""
        n = 2000
        u = np.concatenate([self.cycle(n)] * 2 + [[self.command_range[0]]])
        bounds = np.array([0, n, 2 * n])
        return float(loop_width(u, self.position(u), bounds))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class AsBuilt:
    """A stage as manufactured: its description, nominal and true, and its true behaviour."""

    stage: Stage
    """The nominal stage."""
    manufactured: Stage
    """The stage with its manufacturing deviations."""
    system: MechanicalSystem
    """Model of the manufactured stage."""
    axes: tuple[AsBuiltAxis, ...]
    """True behaviour of each axis."""
    notes: tuple[str, ...]
    """Notes: seed, and figures set to published values."""
    followed: Mapping[str, float] = field(default_factory=dict)
    """Stroke of the drive of each axis whose path a model may give [m]."""
    origins: dict[str, str] = field(default_factory=dict)
    """Origin of each figure of a measurement, by quantity and axis, such as ``straightness x``."""

    def axis(self, name: str) -> AsBuiltAxis:
        """Return an axis by name."""
        for axis in self.axes:
            if axis.name == name:
                return axis
        raise ModelError(has_no("the stage", "axis", name, (a.name for a in self.axes)))


def as_built(
    stage: Stage,
    *,
    seed: int = 0,
    scatter: Scatter | None = None,
    as_published: bool = True,
    strokes: Mapping[str, StrokeMotion] | None = None,
    widths: NeckWidths | None = None,
) -> AsBuilt:
    """Return a virtual stage, on the lumped model.

    Necks, notches, modulus and drives are drawn from a process with scatter. The path of an axis
    over its stroke is that of `flexstage.virtual.model_path`: by `strokes`, the paths of the stage
    as drawn by finite elements, where they are given, else by rigid bodies. Out-of-plane
    straightness, repeatability and the loops of the stacks, which no such model predicts, are
    assumed and drawn too. Where measured figures of the stage are published the virtual stage is
    set to them (necks to the natural frequencies), so that a measurement of it must reproduce them;
    an axis of published straightness has a random path of this size. Measured necks, by `widths`,
    give the bias of the necks, and their scatter where none is given.

    Notes
    -----
    Validity: synthetic, for trials and for planning. Guide errors are smooth curves of order 5,
    hysteresis is not measured, creep and amplifier are neglected.

    Examples
    --------
    >>> from flexstage.stage.designs import design
    >>> built = as_built(design("vgtu-piezo"), seed=1)
    >>> print(f"{built.axis('x').stroke * 1e6:.2f} um")
    63.12 um
    """
    if not stage.axes:
        raise ModelError(f"stage '{stage.name}' has no axis: name a drive and a probe under 'axes'")
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(1,)))
    process = scatter or (Scatter() if widths is None else widths.scattered(Scatter()))
    cut = stage if widths is None else widths.biased(stage)
    manufactured_stage = manufactured(cut, process, seed=seed)
    moved = displacements(stage, process, seed=seed)
    published_rows = Characteristics(stage.published).select(origin="published-measured")
    notes = [f"virtual stage, seed {seed}: simulated with random deviations, not measured"]
    if stage.materials_note:
        notes.append(f"the modulus of the plate deviates, and {stage.materials_note}")
    published = published_rows if as_published else Characteristics()
    frequencies = {row.axis: row.value for row in published.select("natural_frequency_hz")}
    if frequencies:
        manufactured_stage = _tuned(manufactured_stage, frequencies, moved)
        notes.append("necks are adjusted to the published measured natural frequencies")
    if widths is not None:
        notes.append(
            widths.note(
                "in place of which necks meet the published frequencies"
                if frequencies
                else "which its necks are"
            )
        )
    system = displaced_system(manufactured_stage, moved).with_damping(
        ModalDamping(ratio=VIRTUAL_DAMPING_RATIO)
    )
    analysis = analyse(manufactured_stage, system)
    straight = {row.axis for row in published.select("straightness")}
    followed = {a.axis: a.input_displacement for a in analysis.axes if a.axis not in straight}
    paths = model_paths(
        stage, manufactured_stage, moved, followed, process, seed=seed, nominal=strokes
    )
    axes = []
    for state in analysis.axes:
        mode = axis_mode(system, analysis.modes["removed"], state.drive, state.probe)
        figures = {row.quantity: row.value for row in published if row.axis == state.axis}
        path = paths.get(state.axis)
        axes.append(_axis(manufactured_stage, system, state, mode, figures, path, rng))
    if any(row.quantity != "natural_frequency_hz" for row in published):
        notes.append(
            "stroke, straightness and loop width equal the published measured values where there "
            "are any"
        )
    if paths:
        models = " and ".join(sorted({path.model for path in paths.values()}))
        notes.append(
            f"the path of {', '.join(paths)} over the stroke is that of the {models} model, with "
            "random deviations of necks, notches and drives"
        )
    return AsBuilt(
        stage=stage,
        manufactured=manufactured_stage,
        system=system,
        axes=tuple(axes),
        notes=tuple(notes),
        followed=followed,
        origins=figure_origins(
            stage, published, {name: path.model for name, path in paths.items()}
        ),
    )


def _axis(
    stage: Stage,
    system: MechanicalSystem,
    state: AxisAnalysis,
    mode: int,
    published: Mapping[str, float],
    path: ModelPath | None,
    rng: np.random.Generator,
) -> AsBuiltAxis:
    drive = stage.drive(state.drive)
    modelled = state.output_displacement if path is None else path.stroke
    stroke = published.get("output_displacement", modelled)
    usual = STRAIGHTNESS * stroke
    lateral = published.get("straightness", usual)
    vertical = published.get("straightness_out_of_plane", usual)
    others = [a.probe for a in system.axes if a.name != state.axis]
    coupling = state.static.readings[others[0]] / state.output_displacement if others else 0.0
    yaw_rate = state.static.body_motion[system.probe(state.probe).body][2] / stroke
    guide = random_guide(
        stroke,
        {
            "along": published.get("linearity", usual),
            "across": lateral,
            "vertical": vertical,
            "roll": vertical / GUIDE_LENGTH,
            "pitch": vertical / GUIDE_LENGTH,
            "yaw": lateral / GUIDE_LENGTH,
        },
        {
            "across": coupling + DIRECTION_SPREAD * float(rng.standard_normal()),
            "vertical": DIRECTION_SPREAD * float(rng.standard_normal()),
            "yaw": yaw_rate,
        },
        rng,
    )
    if path is not None:
        guide = path.over(guide)
    hysteresis = None
    commands, unit = (0.0, state.input_displacement), "m"
    if isinstance(drive, PiezoStack) and drive.voltage_range is not None:
        commands, unit = drive.voltage_range, "V"
        width = published.get("hysteresis_loop_width")
        share = LOOP_WIDTH if width is None else width / stroke
        hysteresis = virtual_stack(commands, stroke, share, plays=FINE_PLAYS)
    step = drive.mounted.smallest_displacement
    axis = AsBuiltAxis(
        name=state.axis,
        command_range=commands,
        command_unit=unit,
        guide=guide,
        hysteresis=hysteresis,
        reversal=REVERSAL * stroke,
        repeatability=REPEATABILITY * stroke,
        mode=mode,
        smallest_step=None if step is None else step * stroke / state.input_displacement,
    )
    if hysteresis is None:
        return axis
    return replace(axis, low_end=float(axis.position(axis.cycle(_SETTLING)).min()))


def _tuned(
    nominal: Stage, frequencies: Mapping[str, float], moved: Mapping[str, tuple[float, float]]
) -> Stage:
    """Adjust necks until the frequencies of the axes are the measured ones."""
    targets = {
        ("natural_frequency_hz", axis): Estimate(
            value=f,
            unit="Hz",
            components=(Component(name="measured", uncertainty=1e-6 * f, kind="B"),),
        )
        for axis, f in frequencies.items()
    }
    necks = [
        UpdateParameter(name=f"necks of {axis}", kind="neck_factor", spread=0.1, hinges=hinges)
        for axis, hinges in _bent_by(nominal, moved).items()
        if axis in frequencies
    ]
    return update_stage(
        nominal, targets, parameters=necks, model=lambda stage: displaced_system(stage, moved)
    ).stage


def _bent_by(
    nominal: Stage, moved: Mapping[str, tuple[float, float]]
) -> dict[str, tuple[str, ...]]:
    """Return by axis the hinges that its mode strains more than the mode of any other axis."""
    system = displaced_system(nominal, moved)
    layout = layout_of(nominal)
    bare = modes(system, drives="removed")
    names = [axis.name for axis in system.axes]
    shapes = bare.shapes[
        :, [axis_mode(system, bare, axis.drive, axis.probe) for axis in system.axes]
    ]
    groups: dict[str, list[str]] = {name: [] for name in names}
    for spring in hinge_springs(nominal):
        e = hinge_matrix(layout, spring.hinge) @ shapes
        energy = np.einsum("ik,ij,jk->k", e, spring.stiffness, e)
        groups[names[int(np.argmax(energy))]].append(spring.hinge.name)
    return {axis: tuple(hinges) for axis, hinges in groups.items() if hinges}


def _falling(u: Array) -> NDArray[np.bool_]:
    """Return for each command whether it is below the last different one."""
    change = np.sign(np.diff(u, prepend=u[:1]))
    turns = np.where(change != 0.0, np.arange(u.size), 0)
    last = np.maximum.accumulate(turns)
    return change[last] < 0.0


def platform_stroke(stage: Stage, axis: str) -> float | None:
    """Return the stroke at the platform [m]: published, else by the lumped model.

    None where the drive has no stroke.

    Examples
    --------
    >>> from dataclasses import replace
    >>> from flexstage.stage.designs import design
    >>> stage = design("vgtu-piezo")
    >>> for one in (stage, replace(stage, published=())):
    ...     print(f"{1e6 * platform_stroke(one, 'x'):.2f} um")
    63.12 um
    67.54 um
    """
    published = measured_value(stage.published, "output_displacement", axis)
    port = stage.axis(axis)
    drive = stage.drive_of(axis)
    stroke = drive.mounted.stroke
    if published is not None or stroke is None:
        return published
    from flexstage.lumped import lumped_system
    from flexstage.system import static_displacements

    solution = static_displacements(lumped_system(stage), {drive.name: stroke})
    return abs(float(solution.readings[port.probe]))


def loop_share(stage: Stage, axis: str, stroke: float) -> float:
    """Return the relative loop width of an axis [1]: published, else usual."""
    width = measured_value(stage.published, "hysteresis_loop_width", axis)
    return LOOP_WIDTH if width is None else width / stroke


#: Figures that a simulated stage is set to where they are published.
_SET = frozenset(
    (
        "output_displacement",
        "natural_frequency_hz",
        "straightness",
        "straightness_out_of_plane",
        "linearity",
        "hysteresis_loop_width",
    )
)


def figure_origins(
    stage: Stage, published: Characteristics, paths: Mapping[str, str]
) -> dict[str, str]:
    """Return the origin of each figure, by quantity and axis, such as ``straightness x``.

    The text begins with ``published``, ``model``, ``scatter`` or ``assumed``; `paths` gives the
    model of the path of each axis that has one.
    """
    origins: dict[str, str] = {}
    for axis in stage.axes:
        piezo = isinstance(stage.drive_of(axis.name), PiezoStack)
        figures = _of_axis(paths.get(axis.name), piezo=piezo)
        known = {row.quantity for row in published if row.axis == axis.name} & _SET
        # the loop of a stack gives its linearity
        figures |= dict.fromkeys(known - ({"linearity"} if piezo else set()), "published")
        origins |= {f"{quantity} {axis.name}": text for quantity, text in figures.items()}
    if len(stage.axes) == 2:
        names = [axis.name for axis in stage.axes]
        for joint, of in (
            ("workspace_area", "output_displacement"),
            ("squareness", "cross_coupling"),
        ):
            of_each = dict.fromkeys(origins[f"{of} {name}"] for name in names)
            origins[f"{joint} {''.join(names)}"] = "; ".join(of_each)
    return origins


def _of_axis(path: str | None, *, piezo: bool) -> dict[str, str]:
    """Return the origins for an axis without published figures."""
    bow = f"assumed: {100.0 * STRAIGHTNESS:g} % of the stroke"
    turn = f"assumed: straightness over {1e3 * GUIDE_LENGTH:g} mm"
    sensor, lumped = "assumed: sensors of the laboratory", "model: lumped, with scatter"
    figures = {
        "output_displacement": lumped,
        "natural_frequency_hz": lumped,
        "damping_ratio": f"assumed: {100.0 * VIRTUAL_DAMPING_RATIO:g} %",
        "repeatability": f"assumed: {100.0 * REPEATABILITY:g} % of the stroke",
        "resolution": sensor if piezo else "assumed: smallest step of the drive, as described",
        "noise": sensor,
        "drift": sensor,
        "linearity": "assumed: loop of the stack" if piezo else bow,
        "hysteresis_loop_width": f"assumed: {100.0 * (LOOP_WIDTH if piezo else REVERSAL):g} % of "
        "the stroke",
        "straightness": bow,
        "straightness_out_of_plane": bow,
        "cross_coupling": f"assumed: within {1e3 * DIRECTION_SPREAD:g} mrad of the lumped model",
        "parasitic_rotation": turn,
        "roll": turn,
        "pitch": turn,
    }
    if path is not None:
        in_plane = ("output_displacement", "straightness", "cross_coupling", "parasitic_rotation")
        figures |= dict.fromkeys(in_plane, f"model: {path}, over the stroke, with scatter")
        lean = "scatter: lean of notches, lines of drives"
        figures |= {"roll": lean, "pitch": lean}
    return figures
