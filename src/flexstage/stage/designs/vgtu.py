"""The two stages of the study: dimensions, drives, and published figures.

One is reduced and driven by screws, the other amplified and driven by piezoelectric stacks. The
study prints no dimensions: the geometries are reconstructions, see the notes of each.
"""

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

from flexstage.quantities.characteristic import Characteristic
from flexstage.quantities.quantity import QUANTITIES, number
from flexstage.stage import Stage
from flexstage.stage.designs.nested_xy import NESTED_XY, NestedXYParameters, nested_xy
from flexstage.stage.designs.nested_xy_axis import AxisParameters
from flexstage.stage.designs.parameters import ParameterSet
from flexstage.stage.drive import ScrewActuator, StackActuator

#: Claimed reduction of motion errors against a traditional stage, which is not named, by stage [1];
#: `flexstage.studies.traditional` examines the claim.
MOTION_ERROR_CLAIMS: Mapping[str, float] = {"vgtu-mechanical": 0.44, "vgtu-piezo": 0.17}

#: Ranges of the figures of both stages, of `scripts/predicted.py`.
RANGES_PATH = Path(__file__).with_name("vgtu-ranges.json")
#: Natural frequency with the stack of the axis on ideal seats [Hz], in this file.
IDEAL_SEATS = "ideal_seat_frequency_hz"

# note of a figure that is printed once for a stage with two axes
_BOTH_AXES = "printed once, for both axes"
_ANALYTIC, _FEM, _MEASURED = "published-analytic", "published-fem", "published-measured"

# Half a degree of a turn is inferred: with it the three printed resolutions of 0.162, 0.155 and
# 0.157 um follow from the printed ratios 0.33, 111.53/350 and 113.05/350; a turn in a second is as
# fast as a hand turns a fine screw
_SCREW = ScrewActuator(
    pitch=0.35e-3, smallest_step=0.35e-3 / 720, travel=350e-6, largest_speed=0.35e-3
)
# PI PICMA P-887.91, 36 mm long: figures of its data sheet. The study names only "P-887" and 38 um.
_STACK = StackActuator(
    free_stroke=38e-6,
    stiffness=50e6,
    blocking_force=1850.0,
    capacitance=6.4e-6,
    voltage_range=(0.0, 120.0),
    # 0.26 A into the capacitance: the full range as a sine of 100 Hz, with a little to spare
    largest_slew=40e3,
)


def _rows(
    origin: str,
    quantity: str,
    *,
    x: float | None = None,
    y: float | None = None,
    both: float | None = None,
    note: str = "",
    fitted: bool | None = None,
) -> Iterator[Characteristic]:
    """Yield the rows of one published quantity in SI units; `both` is the same for both axes.

    By default the geometry is fitted to the finite-element figures, but not to the input.
    """
    if fitted is None:
        fitted = origin == _FEM and quantity != "input_displacement"
    if both is not None:
        x, y, note = both, both, f"{_BOTH_AXES}; {note}" if note else _BOTH_AXES
    for axis, value in (("x", x), ("y", y)):
        if value is not None:
            yield Characteristic(
                quantity=quantity,
                axis=axis,
                origin=origin,
                value=value,
                unit=QUANTITIES[quantity].unit,
                note=note,
                fitted=fitted,
            )


def _straightness(*, x: tuple[float, float], y: tuple[float, float]) -> Iterator[Characteristic]:
    """Yield the motion errors of each axis across it, in the plane and out of it [m]."""
    for axis, across, (inside, out) in (("x", "y", x), ("y", "x", y)):
        for quantity, along, value in (
            ("straightness", across, inside),
            ("straightness_out_of_plane", "z", out),
        ):
            note = f"motion error along {along} over the entire stroke in {axis}"
            by_axis: dict[str, Any] = {axis: value}
            yield from _rows(_MEASURED, quantity, **by_axis, note=note)


_RECONSTRUCTED = (
    "The geometry is a reconstruction: the study prints no dimensions. It was fitted so that "
    "three-dimensional finite elements give the finite-element figures that the study publishes.",
    "The published finite-element frequencies are reproduced with the frame held at its bolt "
    "holes and the drives removed, and under none of the other conditions tried.",
)


def _published_stage(
    name: str,
    title: str,
    parameters: NestedXYParameters,
    published: tuple[Characteristic, ...],
    notes: tuple[str, ...],
) -> ParameterSet:
    """Return a stage of the study: its dimensions and published figures."""

    def construct() -> Stage:
        return replace(
            nested_xy(parameters),
            name=name,
            title=f"{title} (reconstruction)",
            published=published,
            notes=(*_RECONSTRUCTED, *notes),
        )

    return ParameterSet(name=name, topology=NESTED_XY, parameters=parameters, construct=construct)


#: The screw-driven reduction stage.
MECHANICAL = _published_stage(
    "vgtu-mechanical",
    "XY reduction stage with adjustment screws",
    NestedXYParameters(
        x=AxisParameters(
            lever_arm_input=26.18e-3,
            lever_arm_output=8.89e-3,
            input_position=5e-3,
            lever_width=9e-3,
            lever_edge=1e-3,
            lever_notch_radius=1.5e-3,
            lever_neck=0.6e-3,
            link_length=12e-3,
            link_recess=8e-3,
            leg_position=6e-3,
            leg_bar_length=9e-3,
            leg_notch_radius=1.5e-3,
            leg_neck=1.159e-3,
            input_block_length=8e-3,
            actuator_pocket_length=1e-3,
            actuator=_SCREW,
        ),
        y=AxisParameters(
            lever_arm_input=26.84e-3,
            lever_arm_output=9.34e-3,
            input_position=3.8e-3,
            lever_width=9e-3,
            lever_edge=0.8e-3,
            lever_notch_radius=2e-3,
            lever_neck=0.5e-3,
            link_length=11e-3,
            link_recess=15e-3,
            leg_position=6e-3,
            leg_bar_length=9e-3,
            leg_notch_radius=1.5e-3,
            leg_neck=1.112e-3,
            input_block_length=8e-3,
            actuator_pocket_length=1e-3,
            actuator=_SCREW,
        ),
        platform_length=50e-3,
        platform_height=66e-3,
        aperture_diameter=24e-3,
        platform_wall=12e-3,
        platform_wall_below=20e-3,
        platform_wall_at_recess=8e-3,
        frame_wall=14e-3,
    ),
    published=(
        *_rows(_ANALYTIC, "input_displacement", both=350e-6),
        *_rows(_ANALYTIC, "output_displacement", x=116.5e-6, y=116.5e-6),
        *_rows(_ANALYTIC, "transmission_ratio", both=0.33),
        # the step of the screws is inferred from it, see _SCREW
        *_rows(_ANALYTIC, "resolution", both=0.162e-6, fitted=True),
        *_rows(
            _ANALYTIC,
            "max_stress",
            x=454.5e6,
            note="printed without an axis; set against the larger of the two",
        ),
        *_rows(_ANALYTIC, "natural_frequency_hz", x=501.0, y=709.0),
        *_rows(_FEM, "input_displacement", both=350e-6),
        *_rows(_FEM, "output_displacement", x=111.53e-6, y=113.05e-6),
        *_rows(
            _FEM,
            "transmission_ratio",
            both=0.308,
            note="as printed; 111.53/350 = 0.3187 and 113.05/350 = 0.3230",
        ),
        *_rows(_FEM, "resolution", x=0.155e-6, y=0.157e-6),
        *_rows(_FEM, "max_stress", x=467.5e6, y=384.4e6),
        *_rows(_FEM, "natural_frequency_hz", x=516.75, y=728.42),
        *_rows(
            _MEASURED,
            "output_displacement",
            x=110.1e-6,
            note="measured workspace; printed 5.17 % below the analytic one; these figures give "
            "5.49 %",
        ),
        *_rows(
            _MEASURED,
            "output_displacement",
            y=111.9e-6,
            note="measured workspace; printed 3.62 % below the analytic one; these figures give "
            "3.95 %",
        ),
        *_rows(_MEASURED, "natural_frequency_hz", x=483.9, y=698.18),
        *_rows(
            _MEASURED,
            "linearity",
            x=1.13e-6,
            y=0.83e-6,
            note="motion error along the axis itself over its entire stroke",
        ),
        *_straightness(x=(0.8e-6, 1.4e-6), y=(1.12e-6, 0.92e-6)),
    ),
    notes=(
        "The smallest step of the screws, 0.35 mm/720 or half a degree of a turn, is inferred: "
        "it makes all three published resolutions follow from the published ratios.",
        "Published stress in percent of the yield strength of 505 MPa: analytic 90; finite "
        "elements 92.57 in x and 76.11 in y.",
        "Published claim: motion errors 44 % below those of a traditional stage, which is not "
        "named.",
        "Published differences of the measured workspace: to the analytic one 5.17 % in x and "
        "3.62 % in y, where its figures give 5.49 % and 3.95 %, to finite elements 1.28 % and "
        "1.02 %; of the natural frequencies, measured to analytic, under 3.4 %.",
    ),
)

#: The piezo-driven amplification stage.
PIEZO = _published_stage(
    "vgtu-piezo",
    "XY amplification stage with piezoelectric stacks",
    NestedXYParameters(
        x=AxisParameters(
            lever_arm_input=9.19e-3,
            lever_arm_output=16.83e-3,
            input_position=11.84e-3,
            lever_width=10e-3,
            lever_edge=1e-3,
            lever_notch_radius=1e-3,
            lever_neck=0.55e-3,
            link_length=6e-3,
            link_recess=9e-3,
            leg_position=6e-3,
            leg_bar_length=12e-3,
            leg_notch_radius=1e-3,
            leg_neck=0.724e-3,
            input_block_length=18e-3,
            actuator_pocket_length=36e-3,
            actuator=_STACK,
        ),
        y=AxisParameters(
            lever_arm_input=9.87e-3,
            lever_arm_output=16.94e-3,
            input_position=11.27e-3,
            lever_width=9e-3,
            lever_edge=1e-3,
            lever_notch_radius=1e-3,
            lever_neck=0.4e-3,
            link_length=6e-3,
            link_recess=9e-3,
            leg_position=6e-3,
            leg_bar_length=10e-3,
            leg_notch_radius=1e-3,
            leg_neck=0.451e-3,
            input_block_length=16e-3,
            actuator_pocket_length=36e-3,
            actuator=_STACK,
        ),
        platform_length=48e-3,
        platform_height=48e-3,
        aperture_diameter=22e-3,
        aperture_offset=4e-3,
        platform_wall=12e-3,
        platform_wall_below=12e-3,
        platform_wall_at_recess=14e-3,
        frame_wall=12e-3,
    ),
    published=(
        *_rows(_ANALYTIC, "input_displacement", both=38e-6),
        *_rows(_ANALYTIC, "output_displacement", x=65e-6, y=65e-6),
        *_rows(_ANALYTIC, "transmission_ratio", both=1.7),
        *_rows(_ANALYTIC, "natural_frequency_hz", x=339.0, y=533.0),
        *_rows(_FEM, "input_displacement", both=38e-6),
        *_rows(_FEM, "output_displacement", x=64.6e-6, y=62.71e-6),
        *_rows(_FEM, "transmission_ratio", x=1.7, y=1.65),
        *_rows(_FEM, "max_stress", x=211e6, y=165e6),
        *_rows(_FEM, "natural_frequency_hz", x=320.92, y=533.49),
        *_rows(
            _MEASURED,
            "output_displacement",
            x=63.12e-6,
            note="measured workspace; printed 2.13 % below finite elements; these figures give "
            "2.29 %",
        ),
        *_rows(_MEASURED, "output_displacement", y=60.9e-6, note="measured workspace"),
        *_rows(_MEASURED, "natural_frequency_hz", x=337.0, y=526.93),
        *_straightness(x=(0.11e-6, 0.09e-6), y=(0.2e-6, 0.22e-6)),
        *_rows(_MEASURED, "hysteresis_loop_width", x=7.91e-6, y=7.55e-6, note="open loop"),
        *_rows(
            _MEASURED, "compensated_loop_width", x=0.48e-6, y=0.43e-6, note="inverse feedforward"
        ),
        *_rows(
            _MEASURED, "hysteresis_deviation", x=1.05e-6, y=0.83e-6, note="Bouc-Wen, identified"
        ),
    ),
    notes=(
        "The stacks are taken to be PI PICMA P-887.91, 36 mm long: the study names only P-887 "
        "and a stroke of 38 um; the type is inferred from that stroke and the length of the "
        "pocket.",
        "Published stress in percent of the yield strength: finite elements 41.2 in x and 32.3 "
        "in y; of 505 MPa, on which those of the mechanical stage rest, they would be 41.8 and "
        "32.7.",
        "Published differences of the measured workspace: to the analytic one 2.89 % in x and "
        "6.3 % in y, to finite elements 2.13 %, where its figures give 2.29 %, and 2.87 %; of "
        "the natural frequencies, measured to analytic, under 3.4 %.",
        "Published claim: motion errors 17 % below those of a traditional stage, which is not "
        "named.",
        "Published for hysteresis: inverse feedforward narrows the loop by 93.9 % in x and 94.3 "
        "% in y; the identified model reproduces the measured loop shape within 1 %.",
    ),
)


@dataclass(frozen=True, slots=True, kw_only=True)
class PredictedRanges:
    """The 95 % ranges of the figures of a stage of the study, whose geometry is fitted."""

    values: Mapping[tuple[str, str], tuple[float, float]]
    """Ends of the range by quantity and axis, in the unit of the quantity."""
    source: str
    """Origin of the ranges."""

    def text(self, quantity: str, axis: str, factor: float) -> str:
        """Return a range such as "-0.01 to 0.26", times a factor; empty if unknown."""
        ends = self.values.get((quantity, axis))
        if ends is None:
            return ""
        low, high = (number(factor * end, 3) for end in ends)
        return f"{low} to {high}"


def predicted_ranges(stage: Stage) -> PredictedRanges | None:
    """Return the ranges of a stage of the study; None for one that differs from it."""
    known = next((k for k in (MECHANICAL, PIEZO) if k.name == stage.name), None)
    if known is None or known.construct() != stage:
        return None
    return _stored_ranges(stage.name)


@cache
def _stored_ranges(name: str) -> PredictedRanges:
    stored = json.loads(RANGES_PATH.read_text())[name]
    rows = stored["figures"].values()
    return PredictedRanges(
        values={(row["quantity"], row["axis"]): (row["low"], row["high"]) for row in rows},
        source=(
            f"Ranges at 95 %: {stored['command']}, {stored['created'][:10]}. The geometry is "
            f"fitted: {len(stored['given'])} published finite-element figures inform "
            f"{stored['informed']:.1f} of {stored['dimensions']} dimensions, known to 20 % before."
        ),
    )
