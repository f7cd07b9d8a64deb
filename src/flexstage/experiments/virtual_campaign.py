"""A campaign carried out on a virtual stage: its tests, and the records that they give."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

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
    """The stage, and what it truly does."""
    campaign: Campaign
    """The tests."""
    records: Mapping[str, Record]
    """Records by the names that the tests call them."""

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
    >>> from flexstage.stage.designs import design
    >>> from flexstage.virtual.as_built import as_built
    >>> made = virtual_campaign(as_built(design("vgtu-piezo"), seed=1))
    >>> print(", ".join(test.name for test in made.campaign.tests[:3]))
    motion-x, staircase-x, hold-x
    """
    lab = laboratory or Laboratory()
    hammer = bench or HammerBench(built, lab)
    campaign = _description(built, lab)
    records = {}
    for test in campaign.tests:
        if test.test == "response":
            made = hammer.record(test.axis, seed=seed)
        else:
            made = record_of(test.test, built, lab, test.axis, seed=seed)
        records[test.records[0]] = made
    return VirtualCampaign(built=built, campaign=campaign, records=records)


def _description(built: AsBuilt, lab: Laboratory) -> Campaign:
    """What is measured of a virtual stage.

    An axis with a piezo stack is read by sensors in all six motions while it runs in cycles; any
    other by spheres that a measuring machine probes at stations.
    """
    names = [axis.name for axis in built.axes]
    found = modes(built.system, drives="removed").frequency_hz
    own = [float(found[axis.mode]) for axis in built.axes]
    outputs = tuple(f"acceleration {name}" for name in names)
    tests: list[Test] = []
    for axis in built.axes:
        if axis.hysteresis is not None:
            columns = replace(Columns(command="command", along="along"), **{m: m for m in MOTIONS})
            moved = _test("motion", axis.name, columns)
            moved = replace(moved, transverse="transverse", angle="angle")
        else:
            moved = _test("spheres", axis.name, Columns(command="command", spheres=SPHERES))
        stairs = _test("staircase", axis.name, Columns(command="command", along="along"))
        struck = _test("response", axis.name, Columns(input="force", output=outputs))
        tests += [
            moved,
            replace(stairs, smallest_steps=axis.smallest_step is not None),
            _test("hold", axis.name, Columns(along="along")),
            # in a band about the modes of the axes
            replace(struck, along=None, excitation="hammer", band=(0.6 * min(own), 1.5 * max(own))),
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
        notes=("virtual measurement: simulated, not measured", *built.notes),
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
