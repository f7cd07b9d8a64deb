"""Designs by name, and from the plain data of a stage file."""

import subprocess
import sys
from typing import Any

import pytest

from flexstage.base.errors import FlexstageError, StageError, UnitError
from flexstage.stage import Force, PiezoStack, Screw, check
from flexstage.stage.designs import DESIGNS, build, design
from flexstage.stage.designs.registry import PARAMETER_SETS, TOPOLOGIES

BASED_ON_PIEZO: dict[str, object] = {"based_on": "vgtu-piezo"}


@pytest.mark.parametrize("name", sorted(DESIGNS))
def test_every_design_is_built_once_under_its_own_name(name: str) -> None:
    stage = design(name)
    assert stage.name == name
    assert stage is design(name.upper())
    assert {name for a in stage.axes for name in a.moved_by} == {d.name for d in stage.drives}


@pytest.mark.parametrize("name", sorted(DESIGNS))
def test_every_design_passes_its_check(name: str) -> None:
    found = check(design(name))
    assert [f.message for f in found if f.severity == "error" or f.code == "thin-wall"] == []


def test_every_design_can_be_the_base_of_another() -> None:
    assert set(PARAMETER_SETS) == set(DESIGNS)
    for name, known in PARAMETER_SETS.items():
        assert build(known.topology.name, {"based_on": name}) is design(name)


def test_names_are_corrected() -> None:
    with pytest.raises(StageError, match="did you mean 'vgtu-mechanical'"):
        design("vgtu-mecanical")
    with pytest.raises(StageError, match="did you mean 'nested-xy'"):
        build("nested_xy", {})


def test_a_variation_differs_where_it_says_so_and_nowhere_else() -> None:
    varied = build("nested-xy", BASED_ON_PIEZO | {"x": {"lever_arm_input": "9.5 mm"}})
    base = design("vgtu-piezo")
    assert varied.hinge("xful-u").at[1] == pytest.approx(11.84e-3 + 9.5e-3, rel=1e-12)
    assert varied.drives[1] == base.drives[1]
    assert [b for b in varied.bodies if b.name[0] == "y"] == [
        b for b in base.bodies if b.name[0] == "y"
    ]
    # what was published is of another stage
    assert varied.published == ()
    assert "vgtu-piezo" in varied.notes[0]


def test_every_sort_of_parameter_is_read() -> None:
    stage = build(
        "nested-xy",
        BASED_ON_PIEZO
        | {
            "thickness": "0.5 inch",
            "material": "Al 6061-T6",
            "aperture_diameter": None,
            "mounting_hole_station": 0.37,
            "x": {"actuator": {"voltage_range": ["-20 V", "0.12 kV"], "stiffness": "42 N/um"}},
            "y": {
                "actuator": {
                    "kind": "screw",
                    "pitch": "0.5 mm",
                    "smallest_step": "0.7 um",
                    "travel": "41 um",
                }
            },
        },
    )
    assert stage.thickness == 12.7e-3
    assert stage.material.name == "Al 6061-T6"
    assert stage.body("PY").holes == ()
    stack, screw = stage.drives
    assert isinstance(stack, PiezoStack)
    assert (stack.voltage_range, stack.stiffness, stack.stroke) == ((-20.0, 120.0), 42e6, 38e-6)
    assert isinstance(screw, Screw)
    assert (screw.pitch, screw.stroke, screw.spring) == (0.5e-3, 41e-6, None)


def test_materials_can_be_varied() -> None:
    stage = build(
        "parallelogram", {"material": {"density": "2795 kg/m^3"}, "based_on": "parallelogram"}
    )
    assert (stage.material.density, stage.material.poissons_ratio) == (2795.0, 0.33)


def test_a_family_with_usual_dimensions_needs_no_base() -> None:
    stage = build("parallelogram", {"actuator": {"kind": "force", "largest_force": "3 N"}})
    drive = stage.drive("x")
    assert isinstance(drive, Force)
    assert drive.largest_force == 3.0


def test_a_part_of_a_nested_dimension_is_enough() -> None:
    stage = build("parallelogram", {"leg": {"notch": {"neck_thickness": "0.43 mm"}}})
    usual = design("parallelogram")
    assert stage.hinges[0].profile.neck_thickness == 0.43e-3
    assert stage.hinges[0].at == usual.hinges[0].at
    leaf = {"kind": "corner-filleted", "neck_thickness": "0.3 mm", "notch_length": "29 mm"}
    leg = {"bar_length": None, "notch": leaf | {"fillet_radius": "0.7 mm"}}
    leaves = build("parallelogram", {"leg": leg})
    assert [h.name for h in leaves.hinges] == ["left", "right"]


def test_a_built_in_design_can_be_named_itself() -> None:
    assert build("vgtu-piezo", {}) is design("vgtu-piezo")
    thick = build("vgtu-piezo", {"thickness": "12 mm"})
    assert (thick.thickness, thick.name) == (12e-3, "vgtu-piezo-variation")


REFUSED = [
    ({"x": {"lever_arm_inptu": "9 mm"}}, StageError, "did you mean 'lever_arm_input'"),
    ({"sloot": "1 mm"}, StageError, "did you mean 'slot'"),
    ({"x": {"lever_arm_input": 9.5}}, UnitError, "x.lever_arm_input.*no unit"),
    ({"y": {"leg_neck": "0.5 MPa"}}, UnitError, "y.leg_neck.*not a unit of length"),
    ({"x": "9 mm"}, StageError, "x: expected a mapping"),
    ({"x": {"lever_arm_input": "3 mm"}}, StageError, "must be at least 4.55 mm"),
    ({"mounting_hole_station": "0.4"}, StageError, "a number without a unit"),
    ({"mounting_hole_station": float("nan")}, StageError, "a number without a unit"),
    ({"mounting_hole_station": True}, StageError, "a number without a unit"),
    ({"x": {"actuator": {"kind": "piezzo"}}}, StageError, "did you mean 'piezo'"),
    (
        {"x": {"actuator": {"kind": "screw", "pitch": "1 mm"}}},
        StageError,
        "smallest_step' is missing",
    ),
    ({"x": {"actuator": {"voltage_range": ["0 V"]}}}, StageError, "list of 2 values"),
    ({"x": {"actuator": {"voltage_range": ["0 V", 120]}}}, UnitError, "no unit"),
    ({"x": {"actuator": {"voltage_range": ["9 V", "5 V"]}}}, StageError, "must rise"),
    ({"material": "unobtainium"}, StageError, "unobtainium"),
    ({"material": 7075}, StageError, "no material '7075' in the catalogue"),
    ({"based_on": "vgtu-pieso"}, StageError, "did you mean 'vgtu-piezo'"),
    ({"based_on": "parallelogram"}, StageError, "cannot be the base"),
    ({"based_on": ["vgtu-piezo"]}, StageError, "must be the name"),
]


@pytest.mark.parametrize(("parameters", "kind", "message"), REFUSED)
def test_bad_parameters_are_refused_in_one_sentence(
    parameters: dict[str, Any], kind: type[FlexstageError], message: str
) -> None:
    with pytest.raises(kind, match=message) as caught:
        build("nested-xy", BASED_ON_PIEZO | parameters)
    assert type(caught.value) is kind
    assert "\n" not in str(caught.value)


def test_a_missing_parameter_says_how_to_mend_it() -> None:
    with pytest.raises(StageError, match=r"'x' is missing.*'based_on'"):
        build("nested-xy", {"thickness": "9 mm"})


def test_a_base_goes_with_a_family_only() -> None:
    with pytest.raises(StageError, match="nested-xy"):
        build("vgtu-mechanical", BASED_ON_PIEZO)


def test_designs_are_light() -> None:
    code = "import sys, flexstage.stage.designs; print(*{n.split('.')[0] for n in sys.modules})"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    loaded = set(done.stdout.split())
    assert "flexstage" in loaded
    assert not loaded & {"shapely", "pint", "sympy", "matplotlib", "scipy", "yaml"}


def test_families_say_what_they_are() -> None:
    for name, topology in TOPOLOGIES.items():
        assert topology.name == name
        assert topology.title
        assert topology.source
