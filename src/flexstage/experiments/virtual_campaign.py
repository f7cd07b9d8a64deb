"""A campaign on a virtual stage: tests with their records."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from flexstage.experiments.campaign.plan import Campaign, Columns, Test
from flexstage.experiments.campaign.results import Characterisation, evaluate
from flexstage.quantities.sensor import SensorSpecification
from flexstage.records import Record
from flexstage.system import modes
from flexstage.virtual.as_built import AsBuilt
from flexstage.virtual.imperfections import MOTIONS
from flexstage.virtual.laboratory import SPHERES, HammerBench, Laboratory, record_of


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class VirtualCampaign:
    """Tests of a virtual stage, with their records."""

    built: AsBuilt
    """The stage with its true properties."""
    campaign: Campaign
    """The tests."""
    records: Mapping[str, Record]
    """Records, by their names in the tests."""

    def evaluated(self) -> Characterisation:
        """Evaluate all tests."""
        return evaluate(self.campaign, lambda test: [self.records[n] for n in test.records])


def virtual_campaign(
    built: AsBuilt,
    *,
    laboratory: Laboratory | None = None,
    seed: int = 0,
    bench: HammerBench | None = None,
) -> VirtualCampaign:
    """Measure everything of a virtual stage.

    Parameters
    ----------
    built : AsBuilt
        The stage.
    laboratory : Laboratory, optional
        Sensors and methods of the measurements.
    seed : int
        Random seed of the measurements.
    bench : HammerBench, optional
        Hammer bench of the stage, where campaigns share it.

    Returns
    -------
    VirtualCampaign
        Tests and records.

    Examples
    --------
    >>> from flexstage.stage.designs import design
    >>> from flexstage.virtual.as_built import as_built
    >>> measured = virtual_campaign(as_built(design("vgtu-piezo"), seed=1))
    >>> print(", ".join(test.name for test in measured.campaign.tests[:3]))
    motion-x, staircase-x, hold-x
    """
    lab = laboratory or Laboratory()
    hammer = bench or HammerBench(built, lab)
    campaign = _description(built, lab)
    records = {}
    for test in campaign.tests:
        if test.test == "response":
            record = hammer.record(test.axis, seed=seed)
        else:
            record = record_of(test.test, built, lab, test.axis, seed=seed)
        records[test.records[0]] = record
    return VirtualCampaign(built=built, campaign=campaign, records=records)


def _description(built: AsBuilt, lab: Laboratory) -> Campaign:
    """Return the tests of a virtual stage.

    Sensors read an axis with a piezo stack in all six motions during cycles. Any other axis is
    measured by spheres that a coordinate measuring machine probes at stations.
    """
    names = [axis.name for axis in built.axes]
    frequencies = modes(built.system, drives="removed").frequency_hz
    of_axes = [float(frequencies[axis.mode]) for axis in built.axes]
    outputs = tuple(f"acceleration {name}" for name in names)
    tests: list[Test] = []
    for axis in built.axes:
        if axis.hysteresis is not None:
            roles: dict[str, Any] = {role: role for role in ("command", "along", *MOTIONS)}
            motion = _test("motion", axis.name, Columns(**roles))
            motion = replace(motion, transverse="transverse", angle="angle")
        else:
            motion = _test("spheres", axis.name, Columns(command="command", spheres=SPHERES))
        stairs = _test("staircase", axis.name, Columns(command="command", along="along"))
        impact = _test("response", axis.name, Columns(input="force", output=outputs))
        tests += [
            motion,
            replace(stairs, smallest_steps=axis.smallest_step is not None),
            _test(
                "hold", axis.name, Columns(along="along")
            ),  # in a band about the modes of the axes
            replace(
                impact,
                along=None,
                excitation="hammer",
                band=(0.6 * min(of_axes), 1.5 * max(of_axes)),
            ),
        ]
    if len(names) == 2:
        corners = Columns(corner="corner", x=names[0], y=names[1])
        tests.append(_test("workspace", "".join(names), corners))
    sensors = {"position": lab.position, "transverse": lab.transverse, "angle": lab.angle}
    return Campaign(
        stage=built.stage.name,
        origin="virtual",
        instruments=tuple(
            SensorSpecification(
                name=name,
                calibration=sensor.calibration,
                alignment=sensor.alignment,
                drift=sensor.drift,
            )
            for name, sensor in sensors.items()
        ),
        tests=tuple(tests),
        notes=("virtual measurement: simulated data, not measured", *built.notes),
        origins=built.origins,
    )


def _test(kind: str, axis: str, columns: Columns) -> Test:
    name = f"{kind}-{axis}"
    return Test(
        name=name,
        test=kind,
        axis=axis,
        records=(f"{name}.csv",),
        columns=columns,
        along="position",
    )
