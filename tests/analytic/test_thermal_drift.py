"""Thermal drift with the drives in place: closed forms, benches, lengths, seats, stage files.

Evidence (The two stages of the study): thermal drift by one stack on an aluminium base (ratio and
load line by hand, -1.471 um/K): 0.2 %; by both (superposition): 1e-9
"""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from flexstage.base.errors import ModelError, StageError
from flexstage.fem.superelement import superelement_model
from flexstage.files.request import option_words
from flexstage.lumped import lumped_system
from flexstage.stage import Bench, Stage, read_stage, write_stage
from flexstage.stage.bench import read_expansion
from flexstage.stage.designs import build, design
from flexstage.stage.seat import FlatSeat, Preload, TipSeat
from flexstage.studies.guided_axes import guides_on_one_side
from flexstage.studies.models import fitting_options, run_model
from flexstage.studies.requests import ModelOptions
from flexstage.system import MechanicalSystem, analyse, static_displacements, thermal_drift

PLATE, STACK = 23.6e-6, -3.5e-6
ALUMINIUM = Bench(base=PLATE)


@cache
def bare(name: str = "vgtu-piezo", supports: str = "elastic") -> tuple[Stage, MechanicalSystem]:
    """Return a stage of the study and its model."""
    stage = design(name)
    return stage, superelement_model(stage, supports=supports).system


def stage(expansion: float | None = STACK, name: str = "vgtu-piezo", **fields: object) -> Stage:
    """Return a stage of the study whose drives have a coefficient and other fields."""
    drives = (replace(d, thermal_expansion=expansion, **fields) for d in design(name).drives)
    return replace(design(name), drives=tuple(drives))


EXAMPLES = Path(__file__).parents[2] / "examples"


def test_nothing_moves_where_all_coefficients_are_equal() -> None:
    even = Bench(base=PLATE, holder=PLATE, holder_length=60e-3)
    drift = thermal_drift(stage(PLATE), bare()[1], even)
    for values in (drift.readings, drift.rotations, drift.forces):
        assert all(abs(v) < 1e-18 for v in values.values())
    # nor where a screw is longer than the distance of its points
    _, screws = bare("vgtu-mechanical")
    long = stage(PLATE, "vgtu-mechanical", length=10e-3)
    assert all(abs(v) < 1e-18 for v in thermal_drift(long, screws, even).readings.values())


def test_an_aluminium_base_leaves_the_load_line_of_the_stacks() -> None:
    """v = -G k/(k + k_in) (alpha_p - alpha_s) L, with the other stack in place."""
    drift = thermal_drift(stage(), bare()[1], ALUMINIUM)
    exact = np.zeros(2)
    for name in "xy":
        state = static_displacements(bare()[1], {name: 1.0}, others="in place")
        moved = -(PLATE - STACK) * 36e-3 * 50e6 / (50e6 + state.drive_force[name])
        exact += moved * np.array([state.readings[p] for p in "xy"])
        if name == "x":
            # by hand: ratio 1.660, input stiffness 5.05 N/um of 'analyse', 27.1e-6/K over 36 mm
            hand = -1.660 * 50.0 / (50.0 + 5.05) * 27.1e-6 * 36e-3
            assert exact[0] == pytest.approx(hand, rel=2e-3)
    assert [drift.readings[p] for p in "xy"] == pytest.approx(exact, rel=1e-9)
    assert drift.forces["x"] == pytest.approx(-4.47, abs=0.01)
    assert drift.forces["y"] == pytest.approx(-1.90, abs=0.01)


@pytest.mark.parametrize(
    ("base", "stack", "x", "y"),
    [
        (0.0, -3.5, 122, -868), (6.5, -3.5, -315, -1054), (11.5, -3.5, -651, -1197),
        (23.6, -3.5, -1465, -1543), (0.0, -5.0, 41, -953), (6.5, 0.0, -126, -855),
        (11.5, 11.5, 159, -343), (23.6, 11.5, -654, -689),
    ],
)  # fmt: skip
def test_the_drift_is_the_one_that_was_found_by_hand(
    base: float, stack: float, x: float, y: float
) -> None:
    drift = thermal_drift(stage(1e-6 * stack), bare()[1], Bench(base=1e-6 * base))
    assert [1e9 * drift.readings[p] for p in "xy"] == pytest.approx([x, y], rel=0.02, abs=3.0)


def test_what_of_a_screw_lies_beyond_its_points_expands_against_the_plate() -> None:
    _, system = bare("vgtu-mechanical")
    long = stage(11.5e-6, "vgtu-mechanical", length=10e-3)
    # rigid screws: the elongation is that of the gap of 1 mm between their points
    for base in (0.0, 11.5e-6, PLATE):
        bench = Bench(base=base)
        state = thermal_drift(long, system, bench)
        gap = 11.5e-6 * 10e-3 - PLATE * 9e-3 - base * 1e-3
        load = system.load("temperature").vector * (PLATE - base) / PLATE
        vectors = np.array([d.vector for d in system.drives]).T
        saddle = np.block([[system.K, vectors], [vectors.T, np.zeros((2, 2))]])
        q = np.linalg.solve(saddle, np.concatenate((load, [gap, gap])))[: system.order]
        for p in system.probes:
            assert state.readings[p.name] == pytest.approx(float(p.vector @ q), rel=1e-8)
    assert state.readings["x"] == pytest.approx(-38e-9, rel=0.02)


def test_the_examples_are_the_stages_of_the_study_on_a_bench() -> None:
    for name, x, y in (("piezo", -1465e-9, -1543e-9), ("screw", 1044e-9, 207e-9)):
        on = read_stage(EXAMPLES / f"{name}-stage-on-a-bench.yaml", build)
        system = bare({"piezo": "vgtu-piezo", "screw": "vgtu-mechanical"}[name])[1]
        readings = thermal_drift(on, system).readings
        assert [readings[p] for p in "xy"] == pytest.approx([x, y], rel=0.02)


def test_symmetry_removes_the_drift_across_and_none_along() -> None:
    both, system = stage(), bare()[1]
    one = replace(both, drives=(both.drives[0], replace(both.drives[1], thermal_expansion=PLATE)))
    alone = thermal_drift(one, system, ALUMINIUM)
    assert alone.readings["x"] == pytest.approx(-1471e-9, rel=0.02)
    assert abs(alone.readings["y"] / alone.readings["x"]) < 0.004
    one_sided = guides_on_one_side(both)
    other = superelement_model(one_sided, supports="elastic").system
    along = thermal_drift(one_sided, other, ALUMINIUM).readings["x"]
    assert along == pytest.approx(-1520e-9, rel=0.02)


def test_seats_take_their_share_by_the_secant() -> None:
    soft = stage(seats=(TipSeat(axial_stiffness=10e6),))
    readings = thermal_drift(soft, bare()[1], ALUMINIUM).readings
    assert [1e9 * readings[p] for p in "xy"] == pytest.approx([-1004, -1292], rel=0.02)
    rough = stage(seats=(FlatSeat(roughness_length=0.1e-6),), preload=Preload(force=10.0))
    cooled, warmed = (
        thermal_drift(rough, bare()[1], ALUMINIUM, change=c).readings["x"] for c in (-2.0, 2.0)
    )
    assert abs(warmed) < 0.99 * abs(cooled)  # a seat that opens is softer


def test_the_holder_of_the_sensors_moves_them_along_each_axis() -> None:
    plain, steel = (
        thermal_drift(stage(), bare()[1], b).readings
        for b in (ALUMINIUM, Bench(base=PLATE, holder=11.5e-6, holder_length=60e-3))
    )
    for p in "xy":
        assert steel[p] - plain[p] == pytest.approx((PLATE - 11.5e-6) * 60e-3)
    # a sensor on a body of the stage has no holder
    relative = stage()
    probes = (replace(relative.probes[0], relative_to="PX"), *relative.probes[1:])
    with_own = replace(relative, probes=probes)
    bench = Bench(base=PLATE, holder=11.5e-6, holder_length=60e-3)
    assert thermal_drift(with_own, bare()[1], bench).readings["x"] == pytest.approx(plain["x"])


def test_the_uncertainty_is_that_of_the_coefficients_in_quadrature() -> None:
    known = stage(thermal_expansion_uncertainty=0.72e-6)
    drift = thermal_drift(known, bare()[1], ALUMINIUM)
    up, right = (
        thermal_drift(
            replace(
                known,
                drives=tuple(
                    replace(d, thermal_expansion=STACK + 0.72e-6) if d.name == name else d
                    for d in known.drives
                ),
            ),
            bare()[1],
            ALUMINIUM,
        )
        for name in "xy"
    )
    expected = np.hypot(
        up.readings["y"] - drift.readings["y"], right.readings["y"] - drift.readings["y"]
    )
    assert drift.readings_uncertainty["y"] == pytest.approx(expected, rel=1e-9)
    assert drift.readings_uncertainty["x"] == pytest.approx(39e-9, rel=0.02)
    assert not any(thermal_drift(stage(), bare()[1], ALUMINIUM).rotations_uncertainty.values())


def test_the_analysis_has_a_row_with_its_conditions_and_only_on_a_bench() -> None:
    known = replace(stage(thermal_expansion_uncertainty=0.72e-6), bench=ALUMINIUM)
    table = analyse(known, bare()[1])
    row = next(
        r for r in table.characteristics if (r.quantity, r.axis) == ("thermal_drift_in_place", "x")
    )
    assert row.value == pytest.approx(-1465e-9, rel=0.02)
    assert row.uncertainty == pytest.approx(39e-9, rel=0.02)
    for words in ("base 23.6e-6/K", "'x' -3.5e-6/K ± 0.72e-6/K", "force of drive 'x' -4.5 N/K"):
        assert words in row.note
    turns = table.characteristics.value("thermal_rotation_in_place", "y")
    assert turns == pytest.approx(-0.83e-6, rel=0.02)
    # the tables of stages without a bench do not change
    plain = analyse(bare()[0], bare()[1])
    assert not any("in_place" in r.quantity for r in plain.characteristics)
    assert not any("drives in place is omitted" in note for note in plain.validity)


def test_a_preload_that_temperature_takes_away_is_named() -> None:
    def notes(preload: float) -> list[str]:
        seats = (FlatSeat(roughness_length=0.1e-9),)
        held = stage(seats=seats, preload=Preload(force=preload))
        on = replace(held, bench=replace(ALUMINIUM, temperature_change=5.0))
        return [n for n in analyse(on, bare()[1]).validity if "lifts off" in n]

    assert not notes(50.0)
    (x,) = notes(10.0)
    assert "drive 'x'" in x
    assert "preload of 10.0 N is gone 2.2 K above" in x


def test_what_gives_no_drift_is_said_in_one_sentence() -> None:
    on = replace(stage(), bench=ALUMINIUM)
    rigid = bare(supports="rigid")[1]
    with pytest.raises(ModelError, match=r"with supports rigid .* choose supports elastic"):
        thermal_drift(on, rigid)
    omitted = [n for n in analyse(on, rigid).validity if "is omitted: with supports rigid" in n]
    assert len(omitted) == 1
    with pytest.raises(ModelError, match="the lumped model does not expand: choose superelement"):
        thermal_drift(on, lumped_system(on))
    with pytest.raises(ModelError, match="thermal_expansion of the drive 'x' is not given: add"):
        thermal_drift(bare()[0], bare()[1], ALUMINIUM)
    dead = replace(on, material=replace(on.material, thermal_expansion=None))
    with pytest.raises(ModelError, match="gives no thermal_expansion other than 0"):
        thermal_drift(dead, bare()[1])


def test_stage_files_and_the_option_name_the_bench(tmp_path) -> None:
    bench = Bench(base=11.5e-6, holder=1.3e-6, holder_length=-60e-3, temperature_change=5.0)
    path = tmp_path / "stage.yaml"
    write_stage(replace(stage(), bench=bench), path)
    assert read_stage(path).bench == bench
    path.write_text(
        "flexstage: 1\ndesign: {name: vgtu-piezo}\n"
        "bench: {base: steel, holder: Invar 36, holder_length: -60 mm, temperature_change: 5 K}\n"
    )
    assert read_stage(path, build).bench == bench
    words = option_words(ModelOptions(bench=bench))
    assert words == [
        "--bench",
        "base=0.0000115 1/K,holder=0.0000013 1/K,holder_length=-60 mm,temperature_change=5 K",
    ]
    run = run_model(bare()[0], "lumped", fitting_options("lumped", ModelOptions(bench=bench)))
    assert run.analysis.stage.bench == bench
    assert any("the lumped model does not expand" in note for note in run.analysis.validity)
    assert read_expansion("Al 7075-T6") == PLATE
    with pytest.raises(StageError, match=r"got 'granit'; did you mean 'granite'\?"):
        read_expansion("granit")
    with pytest.raises(StageError, match="needs both its coefficient and its length, got only hol"):
        Bench(base=0.0, holder=1.3e-6)
