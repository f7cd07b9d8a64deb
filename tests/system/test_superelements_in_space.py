"""The model of superelements in space where a user meets it, and against the solid model."""

import json

import numpy as np
import pytest

from flexstage.cli import main
from flexstage.designs import design
from flexstage.studies import run_model
from flexstage.studies.models import ModelOptions
from flexstage.system import modes

# flexstage analyse parallelogram --model solid --json: natural frequencies with the drives removed
# [Hz], figures of its axis in SI units
SOLID_HZ = (191.2492, 880.8859, 1898.292, 1978.345, 2765.636, 8351.565)
SOLID = {
    "transmission_ratio": 0.9999166,
    "max_stress": 102.4706e6,
    "natural_frequency_hz": 191.2492,
    "input_stiffness": 23172.69,
    "out_of_plane_stiffness": 470881.8,
    "out_of_plane_frequency_hz": 880.8859,
}


def run(*words: str) -> int:
    """Analyse the parallelogram with more words; return the exit status."""
    with pytest.raises(SystemExit) as end:
        main(["analyse", "parallelogram", "--model", "superelement-3d", *words])
    return int(end.value.code or 0)


def test_parallelogram_from_the_command_line(capsys: pytest.CaptureFixture[str]) -> None:
    """Measured: frequencies within 0.034 %, stiffness out of the plane 0.015 %, stress 0.54 %."""
    assert run("--json", "--quiet") == 0
    found = json.loads(capsys.readouterr().out)
    assert found["model"] == "superelement-3d"
    frequencies = [mode["natural_frequency_hz"] for mode in found["modes"]["removed"][:6]]
    np.testing.assert_allclose(frequencies, SOLID_HZ, rtol=1e-3)
    rows = {row["quantity"]: row for row in found["characteristics"]}
    assert rows["max_stress"]["origin"] == "superelement-3d"
    for quantity, value in SOLID.items():
        near = 0.02 if quantity == "max_stress" else 1e-3
        assert rows[quantity]["value"] == pytest.approx(value, rel=near), quantity


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--plane", "strain"), "the superelement-3d model has no plane state, got 'strain'"),
        (("--stroke",), "not the superelement-3d one: choose plane"),
        (("--accuracy", "1%"), "plane or solid only, got superelement-3d"),
    ],
)
def test_what_it_has_not(
    words: tuple[str, ...], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(*words) == 2
    assert said in " ".join(capsys.readouterr().err.split())


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", ["vgtu-piezo", "vgtu-mechanical", "bridge", "double-parallelogram", "parallelogram"]
)
def test_against_the_solid_model(name: str) -> None:
    stage = design(name)
    mine = run_model(stage, "superelement-3d", ModelOptions(cache=False)).analysis
    other = run_model(stage, "solid").analysis
    a, b = (modes(x.system).frequency_hz[:6] for x in (mine, other))
    np.testing.assert_allclose(a, b, rtol=1e-3)
    for names in ("probes", "loads"):
        a, b = ({port.name for port in getattr(x.system, names)} for x in (mine, other))
        assert a == b
    for a, b in zip(mine.axes, other.axes, strict=True):
        ratio = b.output_displacement / b.input_displacement
        assert a.output_displacement / a.input_displacement == pytest.approx(ratio, rel=1e-3)
        stress = max(b.static.hinge_stress.values())
        assert max(a.static.hinge_stress.values()) == pytest.approx(stress, rel=0.02)
    for quantity in ("out_of_plane_frequency_hz", "out_of_plane_stiffness"):
        for axis in (a.axis for a in mine.axes):
            value = other.characteristics.value(quantity, axis)
            assert mine.characteristics.value(quantity, axis) == pytest.approx(value, rel=1e-3)
