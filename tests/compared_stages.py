"""Stages with motion errors by formula, for tests of how they are set against each other."""

import numpy as np

from flexstage.studies.guided_axes import CROSSED_ROLLERS, AxisErrors
from flexstage.studies.traditional import LOADS, ComparedStage, TraditionalComparison
from flexstage.virtual.imperfections import Scatter

SAMPLES = 41


def axis(across: float, yaw: float, *, finite_elements: bool = True) -> AxisErrors:
    """An axis whose motion across lies evenly within 10 % of a median [m]."""
    spread = np.linspace(0.9, 1.1, SAMPLES)
    return AxisErrors(
        travel=63e-6,
        geometry=0.7 * across,
        bending=-0.3 * across,
        manufacture=9e-9,
        assembly=2e-9,
        across=across * spread,
        straightness=0.2 * across * spread,
        normal=7e-9 * spread,
        yaw=yaw * spread,
        tilt=0.1 * yaw * spread,
        coupling=2e-3,
        finite_elements=finite_elements,
    )


def stage(title: str, x: float, y: float, drift: float, **choice: bool) -> ComparedStage:
    """A stage by the motion across of its axes [m], and its drift by a kelvin [m]."""
    return ComparedStage(
        title=title,
        axes={"x": axis(x, 3e-6, **choice), "y": axis(y, 11e-6, **choice)},
        frequency_hz={"x": 310.0, "y": 530.0},
        drift=dict.fromkeys(LOADS, (0.6 * drift, 0.8 * drift, -1e-06)),
        size=(0.2, 0.15, 0.01),
        mass=0.9,
        actuators="2 × piezo of 38 µm",
    )


def comparison(**choice: bool) -> TraditionalComparison:
    """A stage of 0.20 um against traditional ones of 0.30, 0.22 and 0.05 um, claimed 17 % less."""
    return TraditionalComparison(
        claim=0.17,
        stage=stage("own", 0.13e-6, 0.20e-6, 1.5e-6, **choice),
        others=(
            stage("worse", 0.30e-6, 0.11e-6, 2.5e-6),
            stage("like it", 0.22e-6, 0.21e-6, 1.0e-6),
            stage("better", 0.02e-6, 0.05e-6, 4.0e-6),
        ),
        catalogue=CROSSED_ROLLERS,
        asymmetric=stage("lame", 0.9e-6, 0.4e-6, 2.0e-6),
        measured=0.21e-6,
        legs={"x": 14e-3, "y": 12e-3},
        scatter=Scatter(),
        samples=SAMPLES,
    )
