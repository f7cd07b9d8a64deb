"""Thermal drift in time: closed forms of bars and lumps, heat balance, the limit of equal changes.

Evidence (The two stages of the study): thermal drift in time, all equally warm, against that per
kelvin: 1e-12; temperatures of 30 bodies in line against Fourier's series of a bar: 2e-3; of the
platforms of the piezo stage against quadratic triangles (scikit-fem), 10 to 300 s: 5 %
"""

import contextlib
import json
import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.sparse.linalg import splu

from flexstage.base.errors import ModelError, StageError
from flexstage.cli import main
from flexstage.fem import plane_model
from flexstage.fem.geometry import body_region, notch_region, stage_faces
from flexstage.fem.superelement import superelement_model
from flexstage.files.request import option_words
from flexstage.hinges import Leaf, RightCircular
from flexstage.lumped import lumped_system
from flexstage.quantities.material import material
from flexstage.stage import (
    Bench,
    Body,
    Circle,
    ExtraMass,
    Hinge,
    Loop,
    Probe,
    Stage,
    read_stage,
    write_stage,
)
from flexstage.stage.designs import design
from flexstage.stage.drive import DriveHeat
from flexstage.stage.seat import FlatSeat, Preload
from flexstage.studies.models import run_model
from flexstage.studies.requests import ModelOptions
from flexstage.system import (
    MechanicalSystem,
    analyse,
    heat_network,
    static_drives,
    static_loads,
    thermal_drift,
    thermal_transient,
)
from tests.peers.gmsh_grid import plane_grid

METAL = material("Al 7075-T6")
WIDTH, STACK = 7e-3, -3.5e-6
HEAT = DriveHeat(capacity=5.3, conductance=0.017, surface=1.1e-3, power=0.23)


def box(x0: float, x1: float, half: float) -> Loop:
    return Loop(((x0, -half), (x1, -half), (x1, half), (x0, half)))


def chain(count: int, bench: Bench) -> Stage:
    """Return bars in line on a fixed block, joined by straight hinges of nearly their height."""
    half, bar, leaf = 2.1e-3, 9e-3, 5e-3
    profile = Leaf(neck_thickness=4.2e-3 - 2e-6, leaf_length=leaf, notch_depth=1e-6)
    bodies = [Body(name="b0", outline=box(-9e-3, -0.5 * leaf, half), fixed=True)]
    hinges = []
    for i in range(1, count + 1):
        neck = (i - 1) * (bar + leaf)
        start = neck + 0.5 * leaf
        bodies.append(Body(name=f"b{i}", outline=box(start, start + bar, half)))
        names = (f"b{i - 1}", f"b{i}")
        hinges.append(
            Hinge(name=f"h{i}", bodies=names, at=(neck, 0.0), direction=0.0, profile=profile)
        )
    return Stage(
        name="chain",
        thickness=WIDTH,
        material=METAL,
        bodies=tuple(bodies),
        hinges=tuple(hinges),
        bench=bench,
    )


def piezo(bench: Bench, heat: DriveHeat | None = HEAT, **fields: object) -> Stage:
    bare = design("vgtu-piezo")
    drives = (replace(d, thermal_expansion=STACK, heat=heat, **fields) for d in bare.drives)
    return replace(bare, drives=tuple(drives), bench=bench)


WARM_AIR = Bench(base=11.5e-6, film_coefficient=6.0, air_change=1.0)


@cache
def system() -> MechanicalSystem:
    return superelement_model(piezo(WARM_AIR), supports="elastic").system


def test_a_lump_warms_exponentially() -> None:
    bench = Bench(base=0.0, film_coefficient=9.0, air_change=2.0, base_change=0.5)
    stage = chain(1, bench)
    network = heat_network(stage)
    # by hand: half of the leaf, bar of 9 by 4.2 mm; faces, and the edges of the bar; the way is
    # the leaf, and the bar to the centre of both
    leaf, height = 4.2e-3 - 2e-6, 4.2e-3
    area = 9e-3 * height + 2.5e-3 * leaf
    capacity = METAL.density * METAL.specific_heat * WIDTH * area
    film = 9.0 * (2.0 * area + WIDTH * 2.0 * (9e-3 + height))
    centre = (9e-3 * height * 7e-3 + 2.5e-3 * leaf * 1.25e-3) / area
    way = 5e-3 / leaf + (centre - 2.5e-3) / height
    hinge = METAL.thermal_conductivity * WIDTH / way
    t = np.array([0.0, 0.7, 4.0, 90.0])
    rate = (film + hinge) / capacity
    exact = (2.0 * film + 0.5 * hinge) / (film + hinge) * (1.0 - np.exp(-rate * t))
    found = network.temperatures(bench, t)[network.index["body", "b1"]]
    assert found == pytest.approx(exact, rel=1e-9)
    # a mass on it stores, and has no surface
    heavy = replace(stage.bodies[1], extra_masses=(ExtraMass(mass=0.05, at=(7e-3, 0.0)),))
    loaded = heat_network(replace(stage, bodies=(stage.bodies[0], heavy)))
    assert loaded.capacity[0] == pytest.approx(capacity + 0.05 * METAL.specific_heat)
    assert loaded.air[0] == pytest.approx(film)
    # along its longest side of 9 mm against its hinge
    assert network.biot["b1"] == pytest.approx((leaf / 5e-3) * 9e-3 / height, rel=1e-9)


def test_a_chain_of_bodies_warms_as_a_bar() -> None:
    """T = 1 - sum 4/((2n + 1) pi) sin(m x/L) exp(-m^2 a t/L^2), m = (2n + 1) pi/2 (Fourier)."""
    count, pitch = 30, 14e-3
    bench = Bench(base=0.0, base_change=1.0)
    network = heat_network(chain(count, bench))
    diffusivity = METAL.thermal_conductivity / (METAL.density * METAL.specific_heat)
    length = count * pitch  # from the first leaf to the end of the last bar
    t = np.array([0.05, 0.2, 0.6]) * length**2 / diffusivity
    odd = (2.0 * np.arange(200) + 1.0)[:, None]
    for i in (1, 7, 18, 30):
        found = network.temperatures(bench, t)[network.index["body", f"b{i}"]]
        m = 0.5 * math.pi * odd
        decay = np.exp(-((m / length) ** 2) * diffusivity * t)
        series = np.sin(m * (i - 0.5 + 2.5 / 14.0) * pitch / length) * decay
        exact = 1.0 - np.sum(4.0 / (math.pi * odd) * series, axis=0)
        assert found == pytest.approx(exact, abs=2e-3)


@pytest.mark.parametrize("period", [None, 170.0])
def test_temperatures_are_those_of_a_step_by_step_solution(period: float | None) -> None:
    bench = replace(WARM_AIR, base_change=-0.4, period=period, mount_conductance=3.0)
    network = heat_network(piezo(bench))

    def slope(t: float, temperature: np.ndarray) -> np.ndarray:
        wave = 1.0 if period is None else math.sin(2.0 * math.pi * t / period)
        heat = network.power + wave * (network.air - 0.4 * network.base)
        return (heat - network.conductance @ temperature) / network.capacity

    t = np.array([0.0, 3.0, 60.0, 400.0])
    options = {"method": "LSODA", "rtol": 1e-9, "atol": 1e-11}
    steps = solve_ivp(slope, (0.0, 400.0), np.zeros(network.capacity.size), t_eval=t, **options)
    assert network.temperatures(bench, t) == pytest.approx(steps.y, abs=1e-7)


def test_heat_is_balanced() -> None:
    bench = Bench(base=0.0, film_coefficient=6.0, mount_conductance=3.0)
    network = heat_network(piezo(bench))
    # rows of G without base and air are sums of zero: heat leaves the network there alone
    assert network.conductance.sum(axis=1) == pytest.approx(network.base + network.air, abs=1e-12)
    assert network.air[network.index["drive", "y"]] == pytest.approx(6.0 * 1.1e-3)
    t = np.linspace(0.0, 900.0, 20001)
    temperature = network.temperatures(bench, t)
    lost = (network.base + network.air) @ temperature
    flown = float(np.sum(0.5 * (lost[1:] + lost[:-1]) * np.diff(t)))
    stored = float(network.capacity @ temperature[:, -1])
    assert stored + flown == pytest.approx(2.0 * 0.23 * 900.0, rel=1e-6)


def test_a_heated_bar_is_warmer_than_its_ends_by_the_parabola() -> None:
    """Mean rise P L/(12 k A) of a bar heated evenly between ends held at their temperature."""
    stage = chain(1, Bench(base=0.0))
    drive = replace(
        design("vgtu-piezo").drives[0],
        pushes="b1",
        reacts="b0",
        at=((3e-3, 0.0), (-3e-3, 0.0)),
        direction=0.0,
        heat=replace(HEAT, conductance=1e-9),
    )
    stage = replace(stage, drives=(drive,))
    network = heat_network(stage)
    settled = network.temperatures(stage.bench, np.array([1e13]))
    assert settled[network.index["drive", "x"], 0] == pytest.approx(0.23 / 12e-9, rel=1e-6)
    # without heat it conducts as a bar
    passive = replace(drive, heat=DriveHeat(capacity=5.3, conductance=0.4))
    bench = Bench(base=0.0, film_coefficient=8.0, air_change=1.0)
    network = heat_network(replace(stage, drives=(passive,), bench=bench))
    body, middle = network.temperatures(bench, np.array([1e9]))[:, 0]
    hinge = float(heat_network(chain(1, bench)).base[0])
    assert (hinge + 0.4) * body == pytest.approx(network.air[0] * (1.0 - body), rel=1e-9)
    assert middle == pytest.approx(0.5 * body, rel=1e-9)


@pytest.mark.parametrize("period", [None, 4e6])
def test_equal_temperatures_give_the_thermal_drift(period: float | None) -> None:
    bench = replace(WARM_AIR, base_change=1.0, holder=1.3e-6, holder_length=50e-3, period=period)
    stage = piezo(bench, replace(HEAT, power=None), length=40e-3)
    time = 1e6 if period is None else 0.25 * period
    drift = thermal_drift(stage, system())
    found = thermal_transient(stage, system(), [time])
    tolerance = 1e-10 if period is None else 1e-3
    for mine, theirs in (
        (found.readings, drift.readings),
        (found.rotations, drift.rotations),
        (found.forces, drift.forces),
    ):
        for name, values in mine.items():
            assert values == pytest.approx([theirs[name]], rel=tolerance)


def test_what_of_a_drive_lies_beyond_its_points_is_as_warm_as_its_reaction() -> None:
    bench = replace(WARM_AIR, mount_conductance=0.3)
    drives = piezo(bench).drives
    both = [
        thermal_transient(
            replace(piezo(bench), drives=(replace(drives[0], length=length), drives[1])),
            system(),
            [150.0],
        )
        for length in (36e-3, 41e-3)
    ]
    warm = STACK * both[0].drives["x"] - METAL.thermal_expansion * both[0].bodies["G"]
    moved = static_drives(piezo(bench), system(), {"x": 1e-6}).static.readings
    for probe in "xy":
        change = both[1].readings[probe] - both[0].readings[probe]
        assert change == pytest.approx(moved[probe] / 1e-6 * 5e-3 * warm, rel=1e-6)


def test_seats_that_lift_off_give_the_secant_of_the_thermal_drift() -> None:
    seats = {"seats": (FlatSeat(roughness_length=0.1e-6),), "preload": Preload(force=10.0)}
    bench = replace(WARM_AIR, base=23.6e-6, base_change=2.0, air_change=2.0)
    stage = piezo(bench, None, **seats)
    drift = thermal_drift(stage, system(), change=2.0)
    found = thermal_transient(stage, system(), [1e6])
    for probe, reading in found.readings.items():
        assert reading[0] == pytest.approx(2.0 * drift.readings[probe], rel=1e-9)
    assert found.forces["x"][0] == pytest.approx(2.0 * drift.forces["x"], rel=1e-9)


def test_a_warm_bar_expands_from_its_neck() -> None:
    """The second of two bars is warm: its probe moves by alpha T times the distance of the neck."""
    bodies = (
        Body(name="block", outline=box(-14e-3, -1e-3, 5e-3), fixed=True,
             mounting_holes=(Circle((-8e-3, 0.0), 2e-3),)),
        Body(name="bar", outline=box(1e-3, 31e-3, 5e-3)),
    )  # fmt: skip
    notch = RightCircular(radius=1e-3, neck_thickness=0.6e-3)
    stage = Stage(
        name="bar",
        thickness=WIDTH,
        material=METAL,
        bodies=bodies,
        hinges=(
            Hinge(name="h", bodies=("block", "bar"), at=(0.0, 0.0), direction=0.0, profile=notch),
        ),
        probes=(Probe(name="end", body="bar", at=(31e-3, 1e-3), direction=0.0),),
        bench=Bench(base=0.0, film_coefficient=9.0, air_change=1.0),
    )  # fmt: skip
    for model in (superelement_model(stage, cache=False), plane_model(stage)):
        found = thermal_transient(stage, model.system, [5.0, 40.0, 1e6])
        free = METAL.thermal_expansion * 31e-3 * found.bodies["bar"]
        assert found.readings["end"] == pytest.approx(free, rel=2e-5)
        assert not found.bodies["block"].any()


@pytest.mark.slow
def test_bodies_expand_alike_in_both_models() -> None:
    stage = piezo(WARM_AIR)
    meshed = plane_model(stage, supports="elastic").system
    for model in (system(), meshed):
        together = np.sum([b.thermal for b in model.bodies], axis=0)
        uniform = model.load("temperature").vector
        assert together == pytest.approx(uniform, abs=1e-12 * np.abs(uniform).max())
    times = [10.0, 60.0, 1e4]
    ours, theirs = (thermal_transient(stage, m, times) for m in (system(), meshed))
    for probe, reading in ours.readings.items():
        within = 3e-3 * np.abs(reading).max()
        assert reading == pytest.approx(theirs.readings[probe], abs=within)
    assert ours.rotations["PY"] == pytest.approx(theirs.rotations["PY"], rel=3e-3)


@pytest.mark.slow
def test_bodies_are_as_warm_as_by_finite_elements() -> None:
    """Heat of the air in a plane of quadratic triangles, by steps of Crank and Nicolson."""
    skfem = pytest.importorskip("skfem", reason="scikit-fem is not installed")
    film, step, times = 6.0, 1.0, (10.0, 100.0, 300.0)
    stage = piezo(Bench(base=0.0, film_coefficient=film, air_change=1.0), None)
    width, conductivity = stage.thickness, METAL.thermal_conductivity
    grid = plane_grid(stage, stage_faces(stage).shape, neck_size=0.7, size=8e-3)
    mesh = skfem.MeshTri2(
        doflocs=np.ascontiguousarray(grid.nodes.T), t=np.ascontiguousarray(grid.elements.T)
    )

    def inside(body: str) -> np.ndarray:
        names = {body_region(body)} | {
            notch_region(h.name, i) for h in stage.hinges for i in (0, 1) if h.bodies[i] == body
        }
        return np.flatnonzero([region in names for region in grid.regions])

    element = skfem.ElementTriP2()
    plane, edges = skfem.Basis(mesh, element), skfem.FacetBasis(mesh, element)
    flow = skfem.BilinearForm(
        lambda u, v, _: conductivity * width * (u.grad * v.grad).sum(axis=0) + 2.0 * film * u * v
    ).assemble(plane) + skfem.BilinearForm(lambda u, v, _: film * width * u * v).assemble(edges)
    heat = skfem.LinearForm(lambda v, _: 2.0 * film * v).assemble(plane)
    heat += skfem.LinearForm(lambda v, _: film * width * v).assemble(edges)
    stored = METAL.density * METAL.specific_heat * width
    mass = skfem.BilinearForm(lambda u, v, _: stored * u * v).assemble(plane)
    held = plane.get_dofs(elements=inside("G")).flatten()
    free = np.setdiff1d(np.arange(plane.N), held)
    flow, mass, heat = flow[free][:, free], mass[free][:, free], heat[free]
    solver = splu((mass + 0.5 * step * flow).tocsc())
    temperature, found = np.zeros(free.size), {}
    for i in range(1, int(times[-1] / step) + 1):
        lost = 0.5 * step * (flow @ temperature)
        temperature = solver.solve(mass @ temperature - lost + step * heat)
        if i * step in times:
            found[i * step] = temperature
    network = heat_network(stage)
    ours = network.temperatures(stage.bench, np.array(times))
    for body, tolerance in {"PX": 0.03, "PY": 0.05, "xin": 0.12, "yin": 0.08}.items():
        own = skfem.Basis(mesh, element, elements=inside(body))
        mean = skfem.LinearForm(lambda v, _: v * 1.0).assemble(own)[free]
        mean /= skfem.LinearForm(lambda v, _: v * 1.0).assemble(own).sum()
        exact = [mean @ found[t] for t in times]
        assert ours[network.index["body", body]] == pytest.approx(exact, rel=tolerance)


def test_the_heat_of_a_stage_changes_no_other_figure() -> None:
    cold = superelement_model(design("vgtu-piezo"), supports="elastic").system
    for load in ("temperature", "gravity x"):
        one, other = (static_loads(m, {load: 1.0}).readings for m in (cold, system()))
        assert one == pytest.approx(other, rel=1e-8)
    assert cold.body("PY").thermal is None


def test_the_analysis_has_rows_and_says_how_even_the_temperature_of_bodies_is() -> None:
    stage = piezo(WARM_AIR)
    table = analyse(stage, system())
    rows = {(r.quantity, r.axis): r for r in table.characteristics}
    found = thermal_transient(stage, system())
    assert rows["drift_in_time", "x"].value == max(found.readings["x"], key=abs)
    assert rows["rotation_in_time", "y"].value == max(found.rotations["PY"], key=abs)
    assert rows["thermal_time_constant", "stage"].value == found.time_constants[0]
    for words in ("0.230 W in drive 'x'", "air +1 K (step)", "film 6 W/(m² K)"):
        assert words in rows["drift_in_time", "x"].note
    note = next(n for n in table.validity if "Biot numbers" in n)
    assert f"that of 'PX' is {found.biot['PX']:.1f}" in note
    data = found.to_dict()
    assert data["series"]["reading.y"][-1] == found.readings["y"][-1]
    assert len(found.plot().axes) == 2
    # within a period of the air, and without: the notes say which
    cycle = replace(stage, bench=replace(WARM_AIR, period=3600.0))
    row = next(r for r in analyse(cycle, system()).characteristics if r.quantity == "drift_in_time")
    assert "air +1 K (period of 60.0 min)" in row.note
    assert row.note.startswith("when periodic; ")
    # what begins from rest has died out
    found = thermal_transient(cycle, system())
    last, before = found.readings["x"][-49:], found.readings["x"][-97:-48]
    assert row.value == max(last, key=abs)
    np.testing.assert_allclose(before, last, rtol=0.0, atol=2e-3 * np.ptp(last))
    cold = piezo(Bench(base=0.0), replace(HEAT, power=None))
    notes = [n for n in analyse(cold, system()).validity if "has no power: give power" in n]
    assert len(notes) == 2


def test_equal_levers_are_alike_in_any_direction() -> None:
    biot = heat_network(replace(design("three-rrr"), bench=WARM_AIR)).biot
    assert biot["lever-2"] == pytest.approx(biot["lever-1"], rel=1e-9)
    assert biot["link-3"] == pytest.approx(biot["link-1"], rel=1e-9)


def test_what_gives_no_drift_in_time_is_said_in_one_sentence() -> None:
    with pytest.raises(ModelError, match="nothing changes: give the bench air_change"):
        thermal_transient(piezo(Bench(base=0.0), None), system())
    stage = piezo(WARM_AIR)
    with pytest.raises(ModelError, match="the lumped model does not expand"):
        thermal_transient(stage, lumped_system(stage))
    cold = superelement_model(design("vgtu-piezo"), supports="elastic").system
    with pytest.raises(ModelError, match="make it of the stage with heat and bench"):
        thermal_transient(stage, cold)
    unknown = replace(stage, material=replace(METAL, specific_heat=None))
    with pytest.raises(ModelError, match="gives no specific_heat: add it to the material"):
        thermal_transient(unknown, system())
    omitted = [n for n in analyse(unknown, system()).validity if "in time is omitted" in n]
    assert len(omitted) == 1
    for ask in (heat_network, lambda s: thermal_transient(s, system())):
        with pytest.raises(ModelError, match="the stage has no bench: add 'bench'"):
            ask(replace(stage, bench=None))
    with pytest.raises(ModelError, match="begin at 0 s, got a time of -5 s"):
        thermal_transient(stage, system(), [-5.0, 3.0])
    loose = heat_network(replace(chain(1, Bench(base=0.0)), hinges=()))
    with pytest.raises(ModelError, match="flows nowhere: give the bench a film_coefficient"):
        loose.modes()
    with pytest.raises(StageError, match="a change of the air needs film_coefficient"):
        Bench(base=0.0, air_change=1.0)
    with pytest.raises(StageError, match="a period needs air_change or base_change"):
        Bench(base=0.0, period=60.0)
    with pytest.raises(StageError, match="capacity"):
        piezo(WARM_AIR, replace(HEAT, capacity=0.0))


def test_stage_files_and_options_name_heat(tmp_path) -> None:
    bench = replace(WARM_AIR, period=86400.0, mount_conductance=2.0, base_change=0.1)
    path = tmp_path / "stage.yaml"
    write_stage(piezo(bench), path)
    back = read_stage(path)
    assert back.bench == bench
    assert [d.heat for d in back.drives] == [HEAT, HEAT]
    words = option_words(ModelOptions(bench=bench))[1]
    assert "film_coefficient=6 W/m^2/K" in words
    run = run_model(piezo(bench), "superelement", ModelOptions(supports="elastic", bench=WARM_AIR))
    assert run.analysis.stage.bench == WARM_AIR


def test_the_command_heats_stacks_by_their_loss(tmp_path, capsys) -> None:
    path = tmp_path / "stage.yaml"
    write_stage(piezo(Bench(base=23.6e-6, film_coefficient=6.0), replace(HEAT, power=None)), path)
    words = ["analyse", str(path), "--supports", "elastic", "--json", "--loss-factor", "2%"]

    def command(*more: str) -> None:
        with contextlib.suppress(SystemExit):
            main([*words, *more])

    command("--rate", "50")
    out = json.loads(capsys.readouterr().out)
    heat = out["stacks"]["x"]["supply"]["heat"]
    row = next(r for r in out["characteristics"] if r["quantity"] == "drift_in_time")
    assert f"{heat:.4f} W in drive 'x'" in row["note"]
    command("--rate", "natural")
    assert "the heat of stack 'x' in time needs --rate in Hz" in capsys.readouterr().err
