"""A stage as it comes from the machine: necks a little off, notches a little out of place."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from flexstage.errors import ModelError
from flexstage.experiment.updating.parameters import with_neck_thickness
from flexstage.lumped import hinge_springs, lumped_system
from flexstage.lumped.assemble import hinge_matrix, layout_of
from flexstage.stage import Stage
from flexstage.system import MechanicalSystem


@dataclass(frozen=True, slots=True, kw_only=True)
class Scatter:
    """How far a process misses what it was told.

    Notes
    -----
    Validity: the usual values are those of good wire erosion, a few micrometres; they are no
    measurement of any machine.
    """

    neck_common: float = 4e-6
    """Standard deviation of what all necks of a stage are off by, as from the wire's width [m]."""
    neck_own: float = 2e-6
    """Standard deviation of what each neck is off by beside that [m]."""
    position: float = 3e-6
    """Standard deviation of each coordinate of a notch [m]."""
    modulus: float = 0.01
    """Relative standard deviation of Young's modulus [1]."""

    def __post_init__(self) -> None:
        for name in ("neck_common", "neck_own", "position", "modulus"):
            if not 0.0 <= (value := getattr(self, name)) < math.inf:
                raise ModelError(f"scatter of {name} must be 0 or more and finite, got {value!r}")


def manufactured(stage: Stage, scatter: Scatter, *, seed: int = 0) -> Stage:
    """Draw one stage from a process.

    Outlines of bodies stay, as the masses that they give change by far less.

    Examples
    --------
    >>> from flexstage.designs import design
    >>> stage = design("vgtu-piezo")
    >>> made = manufactured(stage, Scatter(), seed=3)
    >>> off = made.hinges[0].profile.neck_thickness - stage.hinges[0].profile.neck_thickness
    >>> print(f"{off * 1e6:.1f} um")
    1.3 um
    """
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(0,)))
    shift = scatter.neck_common * rng.standard_normal()
    factor = 1.0 + scatter.modulus * rng.standard_normal()
    hinges = []
    for hinge in stage.hinges:
        own = shift + scatter.neck_own * rng.standard_normal()
        neck = hinge.profile.neck_thickness + own
        if not neck > 0.2 * hinge.profile.neck_thickness:
            raise ModelError(
                f"a scatter of {scatter.neck_common:g} and {scatter.neck_own:g} m leaves hinge "
                f"'{hinge.name}' a neck of {neck:.3g} m: give a finer process"
            )
        hinges.append(
            replace(
                hinge,
                profile=with_neck_thickness(hinge.profile, float(neck)),
            )
        )
    modulus = float(factor) * stage.material.youngs_modulus
    return replace(
        stage, hinges=tuple(hinges), material=replace(stage.material, youngs_modulus=modulus)
    )


def displacements(
    stage: Stage, scatter: Scatter, *, seed: int = 0
) -> dict[str, tuple[float, float]]:
    """Draw how far each notch is out of place, along x and y [m]."""
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(3,)))
    moved = scatter.position * rng.standard_normal((len(stage.hinges), 2))
    return {h.name: (float(d[0]), float(d[1])) for h, d in zip(stage.hinges, moved, strict=True)}


def displaced_system(stage: Stage, moved: Mapping[str, tuple[float, float]]) -> MechanicalSystem:
    """Return the lumped model of a stage whose notches are out of place.

    Each spring acts at its displaced neck; outlines, and with them masses and roots, stay where
    they were drawn. `moved` says by hinge how far its neck is off along x and y [m].

    Examples
    --------
    >>> from flexstage.designs import design
    >>> from flexstage.system import modes
    >>> stage = design("vgtu-piezo")
    >>> off = displaced_system(stage, {"xlko-u": (0.0, 50e-6)})
    >>> change = modes(off).frequency_hz[0] / modes(lumped_system(stage)).frequency_hz[0] - 1.0
    >>> print(f"{100.0 * change:.2f} %")
    0.17 %
    """
    system = lumped_system(stage)
    layout = layout_of(stage)
    K = system.K.copy()
    for spring in hinge_springs(stage):
        dx, dy = moved.get(spring.hinge.name, (0.0, 0.0))
        at = (spring.hinge.at[0] + dx, spring.hinge.at[1] + dy)
        drawn = hinge_matrix(layout, spring.hinge)
        made = hinge_matrix(layout, replace(spring.hinge, at=at))
        K += made.T @ spring.stiffness @ made - drawn.T @ spring.stiffness @ drawn
    return replace(system, K=0.5 * (K + K.T))
