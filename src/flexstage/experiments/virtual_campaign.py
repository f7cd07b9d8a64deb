"""A whole set of virtual measurements of a stage, and what it should bring back."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from flexstage.experiments.campaign.plan import Campaign, Columns, Test
from flexstage.records import Record
from flexstage.sensor import SensorSpecification
from flexstage.system import modes
from flexstage.virtual.as_built import AsBuilt, AsBuiltAxis
from flexstage.virtual.hammer import HammerBench
from flexstage.virtual.imperfections import MOTIONS, straight_line
from flexstage.virtual.laboratory import (
    Laboratory,
    hold_record,
    motion_record,
    sphere_record,
    staircase_record,
    workspace_record,
)
from flexstage.virtual.sensors import SimulatedSensor

_SAMPLES = 2000
#: Share of a level that is averaged: what is left when it has settled, of which one half counts.
_AVERAGED = 0.5 * (1.0 - 0.3)
_CONFIDENCE = 0.95
_SPHERES = tuple(f"SPH{i}" for i in range(1, 6))


def true_figures(
    built: AsBuilt, laboratory: Laboratory | None = None
) -> dict[tuple[str, str], float]:
    """Return the figures of a virtual stage, by quantity and axis.

    They are in the units of `flexstage.quantities.QUANTITIES`, computed from what the stage
    does and from no record; the laboratory gives those that are of the sensor: noise, and the
    resolution of a drive without steps.

    Examples
    --------
    >>> from flexstage.designs import design
    >>> from flexstage.virtual.as_built import as_built
    >>> built = as_built(design("vgtu-piezo"), seed=1)
    >>> print(f"{true_figures(built)['straightness', 'x'] * 1e9:.0f} nm")
    110 nm
    """
    lab = laboratory or Laboratory()
    figures: dict[tuple[str, str], float] = {}
    found = modes(built.system, drives="removed")
    for axis in built.axes:
        guide = axis.guide
        figures |= {
            ("output_displacement", axis.name): axis.stroke,
            ("straightness", axis.name): guide.straightness("across"),
            ("straightness_out_of_plane", axis.name): guide.straightness("vertical"),
            ("cross_coupling", axis.name): guide.slope("across"),
            ("parasitic_rotation", axis.name): guide.range("yaw"),
            ("pitch", axis.name): guide.range("pitch"),
            ("roll", axis.name): guide.range("roll"),
            ("repeatability", axis.name): axis.repeatability,
            ("linearity", axis.name): _linearity(axis),
            ("noise", axis.name): lab.position.noise_rms,
            ("drift", axis.name): 0.0,
            ("resolution", axis.name): _resolution(axis, lab),
            ("natural_frequency_hz", axis.name): float(found.frequency_hz[axis.mode]),
            ("damping_ratio", axis.name): float(found.damping_ratio[axis.mode]),
        }
        figures["hysteresis_loop_width", axis.name] = (
            abs(axis.reversal) if axis.hysteresis is None else axis.loop_width()
        )
    if len(built.axes) == 2:
        first, second = built.axes
        # of the corners, which is that of the chords of both paths
        a, b = (float(g.at(g.stroke, "across")) / g.stroke for g in (first.guide, second.guide))
        figures["squareness", f"{first.name}{second.name}"] = -(math.atan(a) + math.atan(b))
        figures["workspace_area", f"{first.name}{second.name}"] = _area(built)
    return figures


def _area(built: AsBuilt) -> float:
    """Area between the four corners that two full strokes lead to."""
    first, second = built.axes[:2]
    up = float(first.guide.at(first.stroke, "across"))
    aside = float(second.guide.at(second.stroke, "across"))
    return first.stroke * second.stroke - up * aside


def _linearity(axis: AsBuiltAxis) -> float:
    """Range about the least-squares line of the mean of both directions."""
    up = axis.cycle(2 * _SAMPLES)[: _SAMPLES + 1]
    whole = np.concatenate((up, up[-2::-1]))
    position = axis.position(whole)
    mean = 0.5 * (position[: _SAMPLES + 1] + position[_SAMPLES:][::-1])
    return float(np.ptp(mean - straight_line(up, mean)(up)))


def _resolution(axis: AsBuiltAxis, laboratory: Laboratory) -> float:
    """Mean step of the staircase, or the step that two averages of white noise tell apart."""
    from scipy.special import ndtri

    if axis.smallest_step is None:
        samples = int(_AVERAGED * laboratory.per_level)
        factor = 2.0 * math.sqrt(2.0) * float(ndtri(_CONFIDENCE))
        return factor * laboratory.position.noise_rms / math.sqrt(samples)
    low, high = axis.command_range
    middle, steps = 0.5 * (low + high), laboratory.levels - 1
    rise = axis.smallest_step / axis.stroke * (high - low)
    first, last = axis.position(np.array([low, middle, middle + steps * rise]))[1:]
    return float(last - first) / steps


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class VirtualCampaign:
    """Tests of a virtual stage, with their records."""

    built: AsBuilt
    """The stage, and what it truly does."""
    campaign: Campaign
    """The tests."""
    records: Mapping[str, Record]
    """Records by the names that the tests call them."""


def virtual_campaign(
    built: AsBuilt,
    *,
    laboratory: Laboratory | None = None,
    seed: int = 0,
    bench: HammerBench | None = None,
) -> VirtualCampaign:
    """Measure everything of a virtual stage.

    An axis with a piezo stack is read by sensors in all six motions while it runs in cycles; any
    other that is called x or y by spheres that a measuring machine probes at stations.

    Parameters
    ----------
    built : AsBuilt
        The stage.
    laboratory : Laboratory, optional
        What it is measured with.
    seed : int
        Seed of everything that a measurement adds.
    bench : HammerBench, optional
        That of the stage, where many campaigns share it.

    Returns
    -------
    VirtualCampaign
        Tests and records.

    Examples
    --------
    >>> from flexstage.designs import design
    >>> from flexstage.virtual.as_built import as_built
    >>> made = virtual_campaign(as_built(design("vgtu-piezo"), seed=1))
    >>> print(", ".join(test.name for test in made.campaign.tests[:3]))
    motion-x, staircase-x, hold-x
    """
    lab = laboratory or Laboratory()
    bench = bench or HammerBench(built, lab)
    tests: list[Test] = []
    records: dict[str, Record] = {}
    names = [axis.name for axis in built.axes]

    def add(test: Test, record: Record) -> None:
        tests.append(test)
        records[test.records[0]] = record

    for axis in built.axes:
        own, band = axis.name, _band(built)
        # a measuring machine has no other axes
        if axis.hysteresis is not None or own not in ("x", "y"):
            columns = replace(Columns(command="command", along="along"), **{m: m for m in MOTIONS})
            add(
                _test("motion", own, columns, transverse="transverse", angle="angle"),
                motion_record(built, lab, own, seed=seed),
            )
        else:
            columns = Columns(command="command", spheres=_SPHERES)
            add(_test("spheres", own, columns), sphere_record(built, lab, own, seed=seed))
        add(
            replace(
                _test("staircase", own, Columns(command="command", along="along")),
                smallest_steps=axis.smallest_step is not None,
            ),
            staircase_record(built, lab, own, seed=seed),
        )
        add(_test("hold", own, Columns(along="along")), hold_record(built, lab, own, seed=seed))
        outputs = tuple(f"acceleration {name}" for name in names)
        add(
            Test(
                name=f"response-{own}",
                kind="response",
                axis=own,
                records=(f"response-{own}.csv",),
                columns=Columns(input="force", output=outputs),
                excitation="hammer",
                band=band,
            ),
            bench.record(own, seed=seed),
        )
    if len(names) == 2:
        add(
            _test("workspace", "".join(names), Columns(corner="corner", x=names[0], y=names[1])),
            workspace_record(built, lab, seed=seed),
        )
    return VirtualCampaign(
        built=built,
        campaign=Campaign(
            stage=built.stage.name,
            origin="virtual",
            instruments=tuple(
                _instrument(name, sensor)
                for name, sensor in (
                    ("position", lab.position),
                    ("transverse", lab.transverse),
                    ("angle", lab.angle),
                )
            ),
            tests=tuple(tests),
            notes=("virtual measurement: simulated, not measured", *built.notes),
        ),
        records=records,
    )


def _test(
    kind: str,
    axis: str,
    columns: Columns,
    *,
    transverse: str | None = None,
    angle: str | None = None,
) -> Test:
    return Test(
        name=f"{kind}-{axis}",
        kind=kind,
        axis=axis,
        records=(f"{kind}-{axis}.csv",),
        columns=columns,
        along="position",
        transverse=transverse,
        angle=angle,
    )


def _band(built: AsBuilt) -> tuple[float, float]:
    """A band about the modes of the axes."""
    from flexstage.system import modes

    f = modes(built.system, drives="removed").frequency_hz
    own = [float(f[axis.mode]) for axis in built.axes]
    return 0.6 * min(own), 1.5 * max(own)


def _instrument(name: str, sensor: SimulatedSensor) -> SensorSpecification:
    return SensorSpecification(
        name=name, calibration=sensor.calibration, alignment=sensor.alignment, drift=sensor.drift
    )
