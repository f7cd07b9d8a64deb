"""Motion errors and drift of a stage beside traditional ones, and what holds of the claims."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np

from flexstage.base import progress
from flexstage.base.arrays import Array
from flexstage.base.choose import listed
from flexstage.base.errors import ModelError
from flexstage.base.short_repr import short_repr
from flexstage.files.plain import picked, plain
from flexstage.quantities.characteristic import measured_value
from flexstage.stage import Stage, mass_properties
from flexstage.stage.designs.vgtu import MOTION_ERROR_CLAIMS
from flexstage.stage.mass import outer_size
from flexstage.studies.motion_errors import SAMPLES, AxisErrors, GuidedAxis, axis_errors
from flexstage.studies.traditional_stages import (
    CROSSED_ROLLERS,
    CatalogueGuide,
    axis_dimensions,
    guide_leg,
    guides_on_one_side,
    traditional_axes,
)
from flexstage.system import MechanicalSystem, modes, static_displacements, static_loads
from flexstage.system.characteristics import axis_mode
from flexstage.virtual.imperfections import Scatter
from flexstage.virtual.scattered_motion import drive_of

if TYPE_CHECKING:
    from collections.abc import Iterable

    from flexstage.fem.stroke import FiniteStroke


#: What counts as the motion error of an axis over its travel: all of its motion across, what is
#: left of it beside a straight line, or its rotation in the plane.
Measure = Literal["across", "straightness", "yaw"]
MEASURES: tuple[Measure, ...] = get_args(Measure)

#: Changes of temperature that are set against each other, by the loads of a model: one kelvin, and
#: one kelvin over this length.
SPAN = 0.1
LOADS: Mapping[str, float] = {
    "temperature": 1.0,
    "temperature gradient x": 1.0 / SPAN,
    "temperature gradient y": 1.0 / SPAN,
}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ComparedStage:
    """What is set against each other of a stage."""

    title: str
    """What it is."""
    axes: Mapping[str, AxisErrors]
    """Motion errors by axis."""
    frequency_hz: Mapping[str, float]
    """Natural frequency of the mode by which each drive moves its probe, drives removed [Hz]."""
    drift: Mapping[str, tuple[float, float, float]]
    """Motion of the platform in x, y [m] and its rotation [rad] by each of `LOADS`."""
    size: tuple[float, float, float]
    """Outer length, width and height [m]."""
    mass: float
    """Mass without drives [kg]."""
    actuators: str
    """What drives it, with the strokes that the travel takes."""

    __repr__ = short_repr

    def worse(self, measure: Measure) -> Array:
        """Return the figure of the worse axis of each sample [m, or rad], shape (samples,)."""
        return np.max([getattr(axis, measure) for axis in self.axes.values()], axis=0)

    def median(self, measure: Measure) -> float:
        """Return the median of that over the samples [m, or rad]."""
        return float(np.median(self.worse(measure)))

    @property
    def axis_errors(self) -> dict[str, float]:
        """Median of the motion across of each axis [m]."""
        return {name: float(np.median(axis.across)) for name, axis in self.axes.items()}


@dataclass(frozen=True, slots=True, kw_only=True)
class Reduction:
    """By how much the motion error of a stage is below that of another."""

    against: str
    """The other one."""
    other: float
    """Its motion error, median of its samples [m, or rad]."""
    reduction: float
    """Part by which the median is below it [1]; negative where it is above."""
    share: float
    """Share of pairs of samples in which the claimed reduction is reached [1]."""
    holds: bool
    """Whether the medians have the claimed reduction."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TraditionalComparison:
    """A stage of the study beside traditional ones."""

    claim: float
    """Claimed reduction of motion errors [1]."""
    own: ComparedStage
    """The stage."""
    others: tuple[ComparedStage, ...]
    """Traditional ones, of the same stroke, material, plate and legs."""
    catalogue: CatalogueGuide
    """A guide of which only the catalogue is known."""
    asymmetric: ComparedStage
    """The stage with its guide legs on one side only."""
    measured: float | None
    """Largest motion across that was measured and published [m]."""
    legs: Mapping[str, float]
    """Distance between the necks of a leg by axis [m]."""
    scatter: Scatter
    """The process that made them."""
    samples: int
    """How many of each were made."""

    __repr__ = short_repr

    def data(self) -> dict[str, Any]:
        """Return the comparison as plain data; SI units, shares from 0 to 1.

        Motion errors are medians and 95 % quantiles of the samples.
        """
        stages = (self.own, *self.others, self.asymmetric)
        return {
            **picked(self, "claim", "samples", "measured", "implied", "longest_leg", "scatter"),
            "stages": [
                {
                    **picked(stage, "title", "frequency_hz", "size", "mass", "actuators"),
                    "drift": {
                        load: dict(zip(("x", "y", "rotation"), moved, strict=True))
                        for load, moved in stage.drift.items()
                    },
                    "axes": {
                        name: {
                            **picked(axis, "travel", "geometry", "bending", "manufacture"),
                            **picked(axis, "assembly", "coupling", "finite_elements"),
                            **{
                                what: dict(
                                    zip(("median", "upper"), axis.figures(what), strict=True)
                                )
                                for what in ("across", "straightness", "normal", "yaw", "tilt")
                            },
                        }
                        for name, axis in stage.axes.items()
                    },
                }
                for stage in stages
            ],
            "catalogue": plain(self.catalogue),
            "reductions": {
                measure: [
                    picked(row, "against", "other", "reduction", "share", "holds")
                    for row in self.reductions(measure)
                ]
                for measure in MEASURES
            },
            "verdict": [*verdict(self), *drift_verdict(self)],
        }

    def reductions(self, measure: Measure = "across") -> tuple[Reduction, ...]:
        """Say by how much the stage is below each of the others, by a measure of motion errors.

        What a catalogue states of straightness counts for motion across as well, and says nothing
        of yaw.
        """
        figures = [(s.title, s.worse(measure)) for s in (*self.others, self.asymmetric)]
        if measure != "yaw":
            stated = np.full(self.samples, self.catalogue.straightness)
            figures.append((self.catalogue.title, stated))
        return tuple(self._below(title, measure, figure) for title, figure in figures)

    def _below(self, title: str, measure: Measure, other: Array) -> Reduction:
        own = self.own.worse(measure)
        reduction = 1.0 - float(np.median(own)) / float(np.median(other))
        return Reduction(
            against=title,
            other=float(np.median(other)),
            reduction=reduction,
            # every one against every other: they are made apart
            share=float(np.mean(own[:, None] <= (1.0 - self.claim) * other[None, :])),
            holds=reduction >= self.claim,
        )

    @property
    def knows_straightness(self) -> bool:
        """Whether the path of the stage is known well enough to tell its straightness.

        Rigid bodies, and elastic ones with small displacements, go straight where it is symmetric.
        """
        return all(axis.finite_elements for axis in self.own.axes.values())

    @property
    def implied(self) -> float | None:
        """Motion error of the traditional stage that claim and measured figure belong to [m]."""
        return None if self.measured is None else self.measured / (1.0 - self.claim)

    @property
    def longest_leg(self) -> float:
        r"""Longest leg of a single parallelogram against which the claim holds [m].

        By its arc alone, :math:`l = d^2/2e` with the motion error e that the claim asks of it.
        """
        travel = max(axis.travel for axis in self.own.axes.values())
        asked = self.own.median("across") / (1.0 - self.claim)
        return 0.5 * travel**2 / asked


def compare_traditional(
    stage: Stage,
    system: MechanicalSystem | None = None,
    *,
    strokes: "Iterable[FiniteStroke]" = (),
    samples: int = SAMPLES,
    seed: int = 1,
    scatter: Scatter | None = None,
) -> TraditionalComparison:
    """Set a stage of the study against traditional stages.

    Parameters
    ----------
    stage : Stage
        One of `MOTION_ERROR_CLAIMS`.
    system : MechanicalSystem, optional
        Its model of superelements, where there is one already.
    strokes : iterable of FiniteStroke
        Its strokes by finite elements with finite displacements, where they are known.
    samples : int
        How many of each stage are made.
    seed : int
        Seed of their deviations.
    scatter : Scatter, optional
        The process; the usual one where not given.

    Returns
    -------
    TraditionalComparison
        All of them, by the same models.

    Raises
    ------
    ModelError
        Nothing is claimed of this stage.
    """
    if stage.name not in MOTION_ERROR_CLAIMS:
        raise ModelError(
            f"nothing is claimed of the motion errors of '{stage.name}': take one of "
            f"{', '.join(MOTION_ERROR_CLAIMS)}"
        )
    process = scatter or Scatter()
    own_system = system or _elastic(stage)
    travel = {
        axis.name: _output(own_system, axis.name, stage.drive(drive_of(axis)).stroke or 0.0)
        for axis in stage.axes
    }
    made = {"travel": travel, "scatter": process, "samples": samples, "seed": seed}
    height = 0.5 * stage.thickness
    own = _compared(
        stage.name,
        {name: GuidedAxis(stage=stage, axis=name, offset=(0.0, 0.0, height)) for name in travel},
        {stage: own_system},
        {path.axis: path for path in strokes},
        **made,
    )
    progress.update("asymmetric stage", 0.3)
    lame = guides_on_one_side(stage)
    asymmetric = _compared(
        "the same stage, guides on one side",
        {name: GuidedAxis(stage=lame, axis=name, offset=(0.0, 0.0, height)) for name in travel},
        {},
        {},
        **made,
    )
    others = []
    for i, (title, axes) in enumerate(traditional_axes(stage, travel)):
        progress.update("traditional stages", 0.4 + 0.2 * i)
        others.append(_compared(title, axes, {}, {}, **made))
    measured = [measured_value(stage.published, "straightness", axis) for axis in travel]
    return TraditionalComparison(
        claim=MOTION_ERROR_CLAIMS[stage.name],
        own=own,
        others=tuple(others),
        catalogue=CROSSED_ROLLERS,
        asymmetric=asymmetric,
        measured=max((m for m in measured if m is not None), default=None),
        legs={name: guide_leg(axis_dimensions(stage, name)).neck_distance for name in travel},
        scatter=process,
        samples=samples,
    )


def _elastic(stage: Stage) -> MechanicalSystem:
    from flexstage.fem import superelement_model

    return superelement_model(stage).system


def _output(system: MechanicalSystem, axis: str, stroke: float) -> float:
    port = next(a for a in system.axes if a.name == axis)
    return static_displacements(system, {port.drive: stroke}).readings[port.probe]


def _compared(
    title: str,
    axes: Mapping[str, GuidedAxis],
    known: Mapping[Stage, MechanicalSystem],
    paths: "Mapping[str, FiniteStroke]",
    *,
    travel: Mapping[str, float],
    scatter: Scatter,
    samples: int,
    seed: int,
) -> ComparedStage:
    """Compute what is compared; axes in plates of their own lie one above the other."""
    parts = list(dict.fromkeys(guided.stage for guided in axes.values()))
    systems = {part: known.get(part) or _elastic(part) for part in parts}
    frequencies, errors, drives = {}, {}, []
    for name, guided in axes.items():
        system = systems[guided.stage]
        axis = guided.stage.axis(guided.axis)
        axis_drive = drive_of(axis)
        found = modes(system)
        mode = axis_mode(system, found, axis_drive, axis.probe)
        frequencies[name] = float(found.frequency_hz[mode])
        stroke = travel[name] / _output(system, axis.name, 1.0)
        drives.append(f"{guided.stage.drive(axis_drive).kind} of {1e6 * stroke:.0f} µm")
        errors[name] = axis_errors(
            guided,
            travel[name],
            system,
            scatter,
            path=paths.get(name),
            samples=samples,
            seed=seed,
        )
    # the upper plate is turned by a quarter
    sides = [outer_size(part)[:2][:: -1 if i else 1] for i, part in enumerate(parts)]
    spacers = sum(guided.offset[2] for guided in axes.values() if guided.mounting is None)
    thickness = parts[0].thickness
    return ComparedStage(
        title=title,
        axes=errors,
        frequency_hz=frequencies,
        drift=_drift([systems[part] for part in parts]),
        size=(
            max(s[0] for s in sides),
            max(s[1] for s in sides),
            thickness if len(parts) == 1 else 0.5 * thickness + spacers,
        ),
        # the lower plate carries the upper one, where there are two
        mass=sum(m.mass for m in mass_properties(parts[0]).values()),
        actuators=", ".join(f"{drives.count(one)} × {one}" for one in dict.fromkeys(drives)),
    )


def _drift(systems: list[MechanicalSystem]) -> dict[str, tuple[float, float, float]]:
    """Motion of the last platform by temperature; a second plate adds its own, turned."""
    total = {}
    for load, size in LOADS.items():
        moved = np.zeros(3)
        for i, system in enumerate(systems):
            # the second plate is mirrored at the diagonal: what was x is y
            turned = load if not i else load.translate(str.maketrans("xy", "yx"))
            state = static_loads(system, {turned: size})
            body = system.probe(system.axes[-1].probe).body
            x, y, yaw = state.body_motion[body]
            moved += (y, x, -yaw) if i else (x, y, yaw)
        total[load] = (float(moved[0]), float(moved[1]), float(moved[2]))
    return total


def claim_verdict(found: TraditionalComparison) -> str:
    """Say against which traditional stages the claim holds, by motion across."""
    return (
        f"The claim, {100.0 * found.claim:.0f} % less than a traditional stage, "
        f"{_against(found.reductions())}."
    )


def verdict(found: TraditionalComparison) -> tuple[str, ...]:
    """Say in sentences what of the claims holds, by the figures of a comparison."""
    own = found.own
    across = own.median("across")
    printed = "" if found.measured is None else f" ({1e6 * found.measured:.2f} µm were measured)"
    implied = found.implied
    worse = max(own.axes.values(), key=lambda axis: axis.figures("across")[0])
    legs = " and ".join(sorted({f"{1e3 * v:.0f}" for v in found.legs.values()}))
    sentences = [
        f"The worse axis of {own.title} goes {_um(across)} µm across over its stroke"
        f"{printed}, median of {found.samples} stages as made.",
        f"Of that rigid bodies go {_um(worse.geometry)} µm, elastic ones {_um(abs(worse.bending))} "
        f"µm more; what manufacture adds has a deviation of {_um(worse.manufacture)} µm.",
        claim_verdict(found),
        f"By yaw it {_against(found.reductions('yaw'))}.",
        f"Against a single parallelogram it holds where legs are at most "
        f"{1e3 * found.longest_leg:.1f} mm from neck to neck, by their arc alone; those of the "
        f"stage have {legs} mm.",
    ]
    if found.knows_straightness:
        sentences.insert(3, f"By straightness it {_against(found.reductions('straightness'))}.")
    if implied is not None:
        sentences.append(
            f"With what was measured of the stage, the claim is of a traditional stage that goes "
            f"{1e6 * implied:.2f} µm across."
        )
    return tuple(sentences)


def drift_verdict(found: TraditionalComparison) -> tuple[str, ...]:
    """Say in sentences what symmetry does for the drift with temperature."""
    own, lame = found.own, found.asymmetric
    words = []
    for load, name in (
        ("temperature", "a uniform kelvin"),
        ("temperature gradient x", f"a kelvin over {1e3 * SPAN:.0f} mm in x"),
        ("temperature gradient y", f"a kelvin over {1e3 * SPAN:.0f} mm in y"),
    ):
        one, other = (math.hypot(*s.drift[load][:2]) for s in (own, lame))
        words.append(f"{1e9 * one:.0f} nm instead of {1e9 * other:.0f} nm by {name}")
    less = [math.hypot(*s.drift["temperature"][:2]) for s in (own, *found.others)]
    better = [s.title for s, v in zip(found.others, less[1:], strict=True) if v < less[0]]
    worse = [s.title for s, v in zip(found.others, less[1:], strict=True) if v >= less[0]]
    ranks = [
        f"{word} than {listed(titles)}"
        for word, titles in (("less", worse), ("more", better))
        if titles
    ]
    helps = 1.0 - less[0] / math.hypot(*lame.drift["temperature"][:2])
    change = (
        f"takes {100.0 * helps:.0f} % off" if helps >= 0.0 else f"adds {-100.0 * helps:.0f} % to"
    )
    return (
        f"With guide legs on both sides the platform drifts {listed(words)}: symmetry "
        f"{change} what a uniform change does, and does not remove it, since the drives and levers "
        "of either axis stand on one side of it.",
        f"By a uniform kelvin it drifts {' and '.join(ranks)}.",
    )


def _against(rows: Sequence[Reduction]) -> str:
    """Say against which stages a claim holds, and against which it does not."""
    parts = []
    for holds, words in ((True, "holds against"), (False, "does not hold against")):
        named = [f"{r.against} ({_by(r.reduction)})" for r in rows if r.holds == holds]
        if named:
            parts.append(f"{words} {listed(named)}")
    return ", and ".join(parts)


def _um(value: float) -> str:
    """Write a length in micrometres."""
    return f"{1e6 * value:.3f}"


def _by(reduction: float) -> str:
    """Say how a figure lies to that of another stage."""
    if reduction >= 0.0:
        return f"{100.0 * reduction:.0f} % below it"
    times = 1.0 - reduction
    return f"{times:.1f} times as much" if times < 9.95 else f"{times:.0f} times as much"
