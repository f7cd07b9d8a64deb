"""A whole set of virtual measurements of a stage: records, and the description of the tests."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

from flexstage.experiment.campaign.plan import Campaign, Columns, SensorSpecification, Test
from flexstage.experiment.virtual.as_built import AsBuilt
from flexstage.experiment.virtual.bench import (
    HammerBench,
    hold_record,
    motion_record,
    sphere_record,
    staircase_record,
    workspace_record,
)
from flexstage.experiment.virtual.guide import MOTIONS
from flexstage.experiment.virtual.laboratory import BenchSensor, Laboratory
from flexstage.records import Record

_SPHERES = tuple(f"SPH{i}" for i in range(1, 6))


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
    >>> from flexstage.experiment.virtual.as_built import as_built
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
            add(
                _test("spheres", own, columns),
                sphere_record(built, lab, own, seed=seed),
            )
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


def _instrument(name: str, sensor: BenchSensor) -> SensorSpecification:
    s = sensor.setup
    return SensorSpecification(
        name=name, calibration=s.calibration, alignment=s.alignment, drift=s.drift
    )
