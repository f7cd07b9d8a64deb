"""One virtual stage, made and mounted: what it truly does, and what is published of its axes.

No measurement knows the first. Of the second, a usual figure stands in where there is none.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexstage.base.arrays import Array
from flexstage.base.choose import has_no
from flexstage.base.errors import ModelError
from flexstage.hysteresis.loops import loop_width
from flexstage.hysteresis.model import HysteresisModel
from flexstage.lumped import hinge_springs
from flexstage.lumped.assemble import hinge_matrix, layout_of
from flexstage.measure.updating import UpdateParameter, update_stage
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
    assumed_figures,
)
from flexstage.system import AxisAnalysis, MechanicalSystem, ModalDamping, analyse, modes
from flexstage.system.characteristics import axis_mode
from flexstage.virtual.imperfections import (
    GuideErrors,
    Scatter,
    displaced_system,
    displacements,
    manufactured,
    random_guide,
)
from flexstage.virtual.stack import FINE_PLAYS, virtual_stack

#: Samples of a cycle that is gone through before.
_SETTLING = 100


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class AsBuiltAxis:
    """What one axis truly does."""

    name: str
    """Name of the axis."""
    command_range: tuple[float, float]
    """Ends of the command: voltage [V] of a piezo stack, elongation [m] of a screw."""
    command_unit: str
    """Its unit."""
    guide: GuideErrors
    """Motions beside the one along the axis, and what the position is off by."""
    hysteresis: HysteresisModel | None
    """From command to position, where the drive has one."""
    reversal: float
    """By how much the position is further on the way back, in the middle of the stroke, of a drive
    without hysteresis [m].
    """
    repeatability: float
    """Standard deviation of the position from cycle to cycle [m]."""
    mode: int
    """The mode by which the drive moves the axis."""
    smallest_step: float | None
    """Smallest step of the position, of a drive that has one [m]."""
    low_end: float = 0.0
    """Output of the hysteresis at the low end of the stroke [m], from which positions count."""

    @property
    def stroke(self) -> float:
        """Length of the stroke [m]."""
        return self.guide.stroke

    def position(self, command: ArrayLike) -> Array:
        """Return the position from the low end [m] for commands [V, or m], after two full cycles.

        What differs from cycle to cycle is left out.
        """
        u = np.asarray(command, dtype=np.float64)
        low, high = self.command_range
        if self.hysteresis is None:
            p = (u - low) / (high - low) * self.stroke
            # a loop that is closed at both ends and widest in the middle
            half = np.where(_falling(u), 0.5, -0.5) * self.reversal
            loop = 4.0 * half * (p / self.stroke) * (1.0 - p / self.stroke)
            return p + self.guide.at(p, "along") + loop
        before = np.concatenate([self.cycle(_SETTLING)] * 2)
        found = self.hysteresis.simulate(np.concatenate((before, u))).values[before.size :]
        return found - self.low_end

    def cycle(self, samples: int) -> Array:
        """Return one triangle of commands over the whole range, from the low end."""
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
    """A stage as it was made: the description of what was drawn, and what it truly does."""

    stage: Stage
    """The stage as drawn."""
    made: Stage
    """The stage as made."""
    system: MechanicalSystem
    """Model of the stage as made."""
    axes: tuple[AsBuiltAxis, ...]
    """What each axis does."""
    notes: tuple[str, ...]
    """What was set, and to what."""

    def axis(self, name: str) -> AsBuiltAxis:
        """Return an axis by name."""
        for axis in self.axes:
            if axis.name == name:
                return axis
        raise ModelError(has_no("the stage", "axis", name, (a.name for a in self.axes)))


def as_built(
    stage: Stage, *, seed: int = 0, scatter: Scatter | None = None, as_published: bool = True
) -> AsBuilt:
    """Make a virtual stage, on the lumped model.

    Its necks, notches and modulus come from a process with scatter. What no model of the drawn
    stage knows is drawn too: how straight it moves, what differs from cycle to cycle, and the
    loop of its stacks. Where measured figures of the stage are published these are set to them
    (necks to the natural frequencies), so that measuring it should bring them back.

    Notes
    -----
    Validity: an invention for trials and for planning. Errors of the guides are smooth curves of
    order 5, hysteresis is that of no measured stack, creep and amplifier are left out.

    Examples
    --------
    >>> from flexstage.stage.designs import design
    >>> made = as_built(design("vgtu-piezo"), seed=1)
    >>> print(f"{made.axis('x').stroke * 1e6:.2f} um")
    63.12 um
    """
    if not stage.axes:
        raise ModelError(
            f"stage '{stage.name}' names no axis, a drive and the probe that reads it: add one"
        )
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(1,)))
    process = scatter or Scatter()
    made = manufactured(stage, process, seed=seed)
    moved = displacements(stage, process, seed=seed)
    measured = Characteristics(stage.published).select(origin="published-measured")
    notes = [f"virtual stage, seed {seed}: drawn, not measured"]
    known = measured if as_published else Characteristics()
    frequencies = {row.axis: row.value for row in known.select("natural_frequency_hz")}
    if frequencies:
        made = _tuned(made, frequencies, moved)
        notes.append(
            "necks are set so that the natural frequencies are the published measured ones"
        )
    system = displaced_system(made, moved).with_damping(ModalDamping(ratio=VIRTUAL_DAMPING_RATIO))
    analysis = analyse(made, system)
    axes = []
    for state in analysis.axes:
        mode = axis_mode(system, analysis.modes["removed"], state.drive, state.probe)
        own = {row.quantity: row.value for row in known if row.axis == state.axis}
        axes.append(_axis(made, system, state, mode, own, rng))
    if any(row.quantity != "natural_frequency_hz" for row in known):
        notes.append(
            "stroke, straightness, and width of the loop are the published measured ones, where "
            "there are any"
        )
    if assumed := {axis for quantity, axis in assumed_figures(stage) if quantity == "straightness"}:
        notes.append(
            f"straightness of {', '.join(sorted(assumed))} and the rotations with it are assumed, "
            f"{100.0 * STRAIGHTNESS:g} % of the stroke, and tell nothing of this stage"
        )
    return AsBuilt(stage=stage, made=made, system=system, axes=tuple(axes), notes=tuple(notes))


def _axis(
    made: Stage,
    system: MechanicalSystem,
    state: AxisAnalysis,
    mode: int,
    known: Mapping[str, float],
    rng: np.random.Generator,
) -> AsBuiltAxis:
    drive = made.drive(state.drive)
    stroke = known.get("output_displacement", state.output_displacement)
    usual = STRAIGHTNESS * stroke
    sideways = known.get("straightness", usual)
    upwards = known.get("straightness_out_of_plane", usual)
    others = [a.probe for a in system.axes if a.name != state.axis]
    coupling = state.static.readings[others[0]] / state.output_displacement if others else 0.0
    turned = state.static.body_motion[system.probe(state.probe).body][2] / stroke
    guide = random_guide(
        stroke,
        {
            "along": known.get("linearity", usual),
            "across": sideways,
            "vertical": upwards,
            "roll": upwards / GUIDE_LENGTH,
            "pitch": upwards / GUIDE_LENGTH,
            "yaw": sideways / GUIDE_LENGTH,
        },
        {
            "across": coupling + DIRECTION_SPREAD * float(rng.standard_normal()),
            "vertical": DIRECTION_SPREAD * float(rng.standard_normal()),
            "yaw": turned,
        },
        rng,
    )
    hysteresis = None
    commands, unit = (0.0, state.input_displacement), "m"
    if isinstance(drive, PiezoStack) and drive.voltage_range is not None:
        commands, unit = drive.voltage_range, "V"
        width = known.get("hysteresis_loop_width")
        share = LOOP_WIDTH if width is None else width / stroke
        hysteresis = virtual_stack(commands, stroke, share, plays=FINE_PLAYS)
    step = drive.smallest_displacement
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
    made: Stage, frequencies: Mapping[str, float], moved: Mapping[str, tuple[float, float]]
) -> Stage:
    """Set necks so that the frequencies of the axes are those that were measured."""
    wanted = {
        ("natural_frequency_hz", axis): Estimate(
            value=f,
            unit="Hz",
            components=(Component(name="measured", uncertainty=1e-6 * f, kind="B"),),
        )
        for axis, f in frequencies.items()
    }
    necks = [
        UpdateParameter(name=f"necks of {axis}", kind="neck_factor", spread=0.1, hinges=hinges)
        for axis, hinges in _bent_by(made, moved).items()
        if axis in frequencies
    ]
    return update_stage(
        made, wanted, parameters=necks, model=lambda stage: displaced_system(stage, moved)
    ).stage


def _bent_by(made: Stage, moved: Mapping[str, tuple[float, float]]) -> dict[str, tuple[str, ...]]:
    """By axis, the hinges that its mode strains more than that of any other axis."""
    system = displaced_system(made, moved)
    layout = layout_of(made)
    found = modes(system, drives="removed")
    names = [axis.name for axis in system.axes]
    shapes = found.shapes[
        :, [axis_mode(system, found, axis.drive, axis.probe) for axis in system.axes]
    ]
    groups: dict[str, list[str]] = {name: [] for name in names}
    for spring in hinge_springs(made):
        e = hinge_matrix(layout, spring.hinge) @ shapes
        energy = np.einsum("ik,ij,jk->k", e, spring.stiffness, e)
        groups[names[int(np.argmax(energy))]].append(spring.hinge.name)
    return {axis: tuple(hinges) for axis, hinges in groups.items() if hinges}


def _falling(u: Array) -> NDArray[np.bool_]:
    """Say of each command whether it is below the last one that differs from it."""
    change = np.sign(np.diff(u, prepend=u[:1]))
    moved = np.where(change != 0.0, np.arange(u.size), 0)
    last = np.maximum.accumulate(moved)
    return change[last] < 0.0


def platform_stroke(stage: Stage, axis: str) -> float | None:
    """Return the stroke at the platform [m]: published, else of the lumped model at rest.

    None where the drive says no stroke.

    Examples
    --------
    >>> from dataclasses import replace
    >>> from flexstage.stage.designs import design
    >>> stage = design("vgtu-piezo")
    >>> for known in (stage, replace(stage, published=())):
    ...     print(f"{1e6 * platform_stroke(known, 'x'):.2f} um")
    63.12 um
    67.54 um
    """
    known = measured_value(stage.published, "output_displacement", axis)
    port = stage.axis(axis)
    drive = stage.drive_of(axis)
    stroke = drive.stroke
    if known is not None or stroke is None:
        return known
    from flexstage.lumped import lumped_system
    from flexstage.system import static_displacements

    solution = static_displacements(lumped_system(stage), {drive.name: stroke})
    return abs(float(solution.readings[port.probe]))


def loop_share(stage: Stage, axis: str, stroke: float) -> float:
    """Return the width of an axis's loop over its stroke [1]: published, else usual."""
    width = measured_value(stage.published, "hysteresis_loop_width", axis)
    return LOOP_WIDTH if width is None else width / stroke
