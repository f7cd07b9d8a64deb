"""Comparison of motion errors and drift of a stage with traditional stages, for its claims."""

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
from flexstage.quantities.characteristic import Kind, measured_value
from flexstage.stage import Stage, mass_properties
from flexstage.stage.designs.vgtu import MOTION_ERROR_CLAIMS
from flexstage.stage.mass import outer_size
from flexstage.studies.guided_axes import (
    CROSSED_ROLLERS,
    SAMPLES,
    AxisErrors,
    CatalogueGuide,
    GuidedAxis,
    axis_dimensions,
    axis_errors,
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


#: Measures of the motion error of an axis over its travel: transverse motion, straightness error,
#: or yaw.
Measure = Literal["across", "straightness", "yaw"]
MEASURES: tuple[Measure, ...] = get_args(Measure)

#: Compared changes of temperature, by the loads of a model: one kelvin, and one kelvin over this
#: length [m].
SPAN = 0.1
LOADS: Mapping[str, float] = {
    "temperature": 1.0,
    "temperature gradient x": 1.0 / SPAN,
    "temperature gradient y": 1.0 / SPAN,
}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ComparedStage:
    """Compared figures of a stage."""

    title: str
    """Name of the stage."""
    axes: Mapping[str, AxisErrors]
    """Motion errors by axis."""
    frequency_hz: Mapping[str, float]
    """Natural frequency of the mode of each axis, drives removed [Hz]."""
    drift: Mapping[str, tuple[float, float, float]]
    """Motion of the platform in x, y [m] and its rotation [rad] under each of `LOADS`."""
    size: tuple[float, float, float]
    """Outer length, width and height [m]."""
    mass: float
    """Mass without drives [kg]."""
    actuators: str
    """Actuators, with their strokes over the travel."""

    __repr__ = short_repr

    def worse(self, measure: Measure) -> Array:
        """Return the error of the worse axis for each sample [m, or rad], shape (samples,)."""
        return np.max([getattr(axis, measure) for axis in self.axes.values()], axis=0)

    def median(self, measure: Measure) -> float:
        """Return the median over the samples of the worse axis [m, or rad]."""
        return float(np.median(self.worse(measure)))

    @property
    def axis_errors(self) -> dict[str, float]:
        """Median of the transverse motion of each axis [m]."""
        return {name: float(np.median(axis.across)) for name, axis in self.axes.items()}


@dataclass(frozen=True, slots=True, kw_only=True)
class Reduction:
    """Reduction of the motion error relative to another stage."""

    against: str
    """Name of the other stage."""
    other: float
    """Median motion error of the other stage [m, or rad]."""
    reduction: float
    """Relative reduction of the median [1]; negative for an increase."""
    share: float
    """Share of pairs of samples with the claimed reduction [1]."""
    holds: bool
    """True if the medians have the claimed reduction."""
    kind: Kind = "predicted"
    """What the motion error of the other stage is: predicted, or given by its maker."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TraditionalComparison:
    """Comparison of a stage of the study with traditional ones."""

    claim: float
    """Claimed reduction of motion errors [1]."""
    stage: ComparedStage
    """The stage."""
    others: tuple[ComparedStage, ...]
    """Traditional stages with the same stroke, material, plate and legs."""
    catalogue: CatalogueGuide
    """A commercial guide, by its specification."""
    asymmetric: ComparedStage
    """The stage with guide legs on one side only."""
    measured: float | None
    """Largest published measured transverse motion [m]."""
    legs: Mapping[str, float]
    """Distance between the necks of a leg by axis [m]."""
    scatter: Scatter
    """Scatter of the process."""
    samples: int
    """Number of samples of each stage."""

    __repr__ = short_repr

    def data(self) -> dict[str, Any]:
        """Return the comparison as plain data; SI units, shares from 0 to 1.

        Motion errors are medians and 95 % quantiles of the samples.
        """
        stages = (self.stage, *self.others, self.asymmetric)
        return {
            **picked(self, "claim", "samples", "measured", "implied", "longest_leg", "scatter"),
            "stages": [
                {
                    **picked(stage, "title", "frequency_hz", "size", "mass", "actuators"),
                    "drift": {
                        load: dict(zip(("x", "y", "rotation"), motion, strict=True))
                        for load, motion in stage.drift.items()
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
                    picked(row, "against", "other", "reduction", "share", "holds", "kind")
                    for row in self.reductions(measure)
                ]
                for measure in MEASURES
            },
            "conclusions": [*conclusions(self), *drift_conclusions(self)],
        }

    def reductions(self, measure: Measure = "across") -> tuple[Reduction, ...]:
        """Return the reductions relative to each other stage, by a measure of motion errors.

        The specified straightness of a commercial guide is used for transverse motion as well;
        there is none for yaw.
        """
        figures = [(s.title, s.worse(measure)) for s in (*self.others, self.asymmetric)]
        rows = [self._reduction(title, measure, figure) for title, figure in figures]
        if measure != "yaw":
            specified = np.full(self.samples, self.catalogue.straightness)
            rows.append(self._reduction(self.catalogue.title, measure, specified, "given"))
        return tuple(rows)

    def _reduction(
        self, title: str, measure: Measure, other: Array, kind: Kind = "predicted"
    ) -> Reduction:
        errors = self.stage.worse(measure)
        reduction = 1.0 - float(np.median(errors)) / float(np.median(other))
        return Reduction(
            against=title,
            other=float(np.median(other)),
            reduction=reduction,
            # all pairs, as the samples are independent
            share=float(np.mean(errors[:, None] <= (1.0 - self.claim) * other[None, :])),
            holds=reduction >= self.claim,
            kind=kind,
        )

    @property
    def knows_straightness(self) -> bool:
        """True if finite elements with finite displacements give the straightness of the stage.

        Other models of a symmetric stage have no straightness error.
        """
        return all(axis.finite_elements for axis in self.stage.axes.values())

    @property
    def implied(self) -> float | None:
        """Motion error of a traditional stage that claim and measurement imply [m]."""
        return None if self.measured is None else self.measured / (1.0 - self.claim)

    @property
    def longest_leg(self) -> float:
        r"""Longest leg of a single parallelogram for which the claim holds [m].

        The parasitic arc alone gives :math:`l = d^2/2e`, with the motion error e that the claim
        implies.
        """
        travel = max(axis.travel for axis in self.stage.axes.values())
        implied = self.stage.median("across") / (1.0 - self.claim)
        return 0.5 * travel**2 / implied


def compare_traditional(
    stage: Stage,
    system: MechanicalSystem | None = None,
    *,
    strokes: "Iterable[FiniteStroke]" = (),
    samples: int = SAMPLES,
    seed: int = 1,
    scatter: Scatter | None = None,
) -> TraditionalComparison:
    """Compare a stage of the study with traditional stages.

    Parameters
    ----------
    stage : Stage
        One of `MOTION_ERROR_CLAIMS`.
    system : MechanicalSystem, optional
        Superelement model of the stage, if available.
    strokes : iterable of FiniteStroke
        Strokes by finite elements with finite displacements, if available.
    samples : int
        Number of samples of each stage.
    seed : int
        Seed of the deviations.
    scatter : Scatter, optional
        Scatter of the process; that of wire erosion by default.

    Returns
    -------
    TraditionalComparison
        The comparison, with the same models for all stages.

    Raises
    ------
    ModelError
        There is no claim for this stage.
    """
    if stage.name not in MOTION_ERROR_CLAIMS:
        raise ModelError(
            f"there is no claim on the motion errors of '{stage.name}': choose one of "
            f"{', '.join(MOTION_ERROR_CLAIMS)}"
        )
    process = scatter or Scatter()
    stage_system = system or _elastic(stage)
    travel = {
        axis.name: _output(stage_system, axis.name, stage.drive(drive_of(axis)).stroke or 0.0)
        for axis in stage.axes
    }
    settings = {"travel": travel, "scatter": process, "samples": samples, "seed": seed}
    height = 0.5 * stage.thickness
    compared = _compared(
        stage.name,
        {name: GuidedAxis(stage=stage, axis=name, offset=(0.0, 0.0, height)) for name in travel},
        {stage: stage_system},
        {path.axis: path for path in strokes},
        **settings,
    )
    progress.update("asymmetric stage", 0.3)
    one_sided = guides_on_one_side(stage)
    asymmetric = _compared(
        "the same stage, guides on one side",
        {
            name: GuidedAxis(stage=one_sided, axis=name, offset=(0.0, 0.0, height))
            for name in travel
        },
        {},
        {},
        **settings,
    )
    others = []
    for i, (title, axes) in enumerate(traditional_axes(stage, travel)):
        progress.update("traditional stages", 0.4 + 0.2 * i)
        others.append(_compared(title, axes, {}, {}, **settings))
    measured = [measured_value(stage.published, "straightness", axis) for axis in travel]
    return TraditionalComparison(
        claim=MOTION_ERROR_CLAIMS[stage.name],
        stage=compared,
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
    """Return the figures of a stage; axes in separate plates are stacked."""
    parts = list(dict.fromkeys(guided.stage for guided in axes.values()))
    systems = {part: known.get(part) or _elastic(part) for part in parts}
    frequencies, errors, drives = {}, {}, []
    for name, guided in axes.items():
        system = systems[guided.stage]
        axis = guided.stage.axis(guided.axis)
        axis_drive = drive_of(axis)
        stage_modes = modes(system)
        mode = axis_mode(system, stage_modes, axis_drive, axis.probe)
        frequencies[name] = float(stage_modes.frequency_hz[mode])
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
    # the upper plate is rotated by 90 deg
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
        actuators=", ".join(f"{drives.count(drive)} × {drive}" for drive in dict.fromkeys(drives)),
    )


def _drift(systems: list[MechanicalSystem]) -> dict[str, tuple[float, float, float]]:
    """Return the thermal motion of the top platform, with that of a second, rotated plate."""
    total = {}
    for load, size in LOADS.items():
        motion = np.zeros(3)
        for i, system in enumerate(systems):
            # the second plate is mirrored at the diagonal, which exchanges x and y
            plate_load = load if not i else load.translate(str.maketrans("xy", "yx"))
            state = static_loads(system, {plate_load: size})
            body = system.probe(system.axes[-1].probe).body
            x, y, yaw = state.body_motion[body]
            motion += (y, x, -yaw) if i else (x, y, yaw)
        total[load] = (float(motion[0]), float(motion[1]), float(motion[2]))
    return total


def claim_conclusion(comparison: TraditionalComparison) -> str:
    """Return for which traditional stages the claim holds, by transverse motion."""
    return (
        f"The claim of {100.0 * comparison.claim:.0f} % less transverse motion than a traditional "
        f"stage {_against(comparison.reductions())}."
    )


def conclusions(comparison: TraditionalComparison) -> tuple[str, ...]:
    """Return conclusions on the claims, one a sentence."""
    stage = comparison.stage
    across = stage.median("across")
    measured = comparison.measured
    published = "" if measured is None else f" (published, measured: {1e6 * measured:.2f} µm)"
    implied = comparison.implied
    worse = max(stage.axes.values(), key=lambda axis: axis.figures("across")[0])
    legs = " and ".join(sorted({f"{1e3 * v:.0f}" for v in comparison.legs.values()}))
    sentences = [
        f"The transverse motion of the worse axis of {stage.title} over its stroke is predicted to "
        f"be {_um(across)} µm{published}, the median of {comparison.samples} manufactured stages.",
        f"Rigid bodies contribute {_um(worse.geometry)} µm and elastic ones "
        f"{_um(abs(worse.bending))} µm; the standard deviation by manufacture is "
        f"{_um(worse.manufacture)} µm.",
        claim_conclusion(comparison),
        f"For yaw the claim {_against(comparison.reductions('yaw'))}.",
        f"The claim holds against a single parallelogram with legs of at most "
        f"{1e3 * comparison.longest_leg:.1f} mm between the necks, by their parasitic arc alone; "
        f"legs of the stage have {legs} mm.",
    ]
    if comparison.knows_straightness:
        straightness = _against(comparison.reductions("straightness"))
        sentences.insert(3, f"For straightness the claim {straightness}.")
    if implied is not None:
        sentences.append(
            f"Claim and published measurement imply a transverse motion of {1e6 * implied:.2f} µm "
            "for a traditional stage."
        )
    return tuple(sentences)


def drift_conclusions(comparison: TraditionalComparison) -> tuple[str, ...]:
    """Return conclusions on the effect of symmetry on thermal drift, one a sentence."""
    stage, one_sided = comparison.stage, comparison.asymmetric
    words = []
    for load, name in (
        ("temperature", "a uniform kelvin"),
        ("temperature gradient x", f"a kelvin over {1e3 * SPAN:.0f} mm in x"),
        ("temperature gradient y", f"a kelvin over {1e3 * SPAN:.0f} mm in y"),
    ):
        drift, other = (math.hypot(*s.drift[load][:2]) for s in (stage, one_sided))
        words.append(f"{1e9 * drift:.0f} nm instead of {1e9 * other:.0f} nm for {name}")
    others = comparison.others
    drifts = [math.hypot(*s.drift["temperature"][:2]) for s in (stage, *others)]
    better = [s.title for s, v in zip(others, drifts[1:], strict=True) if v < drifts[0]]
    worse = [s.title for s, v in zip(others, drifts[1:], strict=True) if v >= drifts[0]]
    ranks = [
        f"{word} than that of {listed(titles)}"
        for word, titles in (("smaller", worse), ("larger", better))
        if titles
    ]
    reduction = 1.0 - drifts[0] / math.hypot(*one_sided.drift["temperature"][:2])
    change = (
        f"reduces the drift by a uniform change by {100.0 * reduction:.0f} %"
        if reduction >= 0.0
        else f"increases the drift by a uniform change by {-100.0 * reduction:.0f} %"
    )
    return (
        f"With guide legs on both sides the drift of the platform is {listed(words)}. Symmetry "
        f"{change}, and does not remove it, as drives and levers of each axis are on one side.",
        f"Its drift for a uniform kelvin is {' and '.join(ranks)}.",
    )


def _against(rows: Sequence[Reduction]) -> str:
    """Return the stages for which a claim holds, and those for which it does not.

    A limit given by a maker is no prediction, and is not compared with one.
    """
    parts = []
    predicted = [r for r in rows if r.kind == "predicted"]
    for holds, words in ((True, "holds against"), (False, "does not hold against")):
        stages = [f"{r.against} ({_by(r.reduction)})" for r in predicted if r.holds == holds]
        if stages:
            parts.append(f"{words} {listed(stages)}")
    return ", and ".join(parts)


def _um(value: float) -> str:
    """Write a length in micrometres."""
    return f"{1e6 * value:.3f}"


def _by(reduction: float) -> str:
    """Return a reduction as text."""
    if reduction >= 0.0:
        return f"{100.0 * reduction:.0f} % less"
    times = 1.0 - reduction
    return f"{times:.1f} times as much" if times < 9.95 else f"{times:.0f} times as much"
