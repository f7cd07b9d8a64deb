"""Measured necks: bias and scatter of a process, and the tolerance analysis that uses them."""

from pathlib import Path

import numpy as np
import pytest

from flexstage.base.errors import ModelError
from flexstage.instruments.pi.simulated.address import simulated_controller
from flexstage.instruments.requests import TwinRequest
from flexstage.lumped import lumped_system
from flexstage.stage import Stage
from flexstage.stage.designs import design
from flexstage.studies import run_study
from flexstage.studies.explore.prepare import ready_tolerance
from flexstage.studies.explore.requests import ToleranceRequest
from flexstage.studies.explore.workers import Workers
from flexstage.studies.requests import StudyRequest
from flexstage.system import modes
from flexstage.virtual.as_built import as_built
from flexstage.virtual.build import virtual_stage
from flexstage.virtual.imperfections import Scatter, manufactured
from flexstage.virtual.neck_widths import read_neck_widths

STAGE = design("parallelogram")


def table(folder: Path, *rows: str) -> Path:
    path = folder / "necks.csv"
    path.write_text("\n".join(rows) + "\n")
    return path


def test_bias_and_scatter_of_many_parts_are_those_of_the_process(tmp_path: Path) -> None:
    rng = np.random.default_rng(7)
    truth = (-30.0, 5.0, 2.0)  # um
    rows = ["part,drawn [um],measured [um]"]
    for part in range(400):
        shift = truth[0] + truth[1] * rng.standard_normal()
        for _ in range(8):
            rows.append(f"{part},250,{250.0 + shift + truth[2] * rng.standard_normal():.4f}")
    widths = read_neck_widths(table(tmp_path, *rows), STAGE)
    assert widths.bias * 1e6 == pytest.approx(truth[0], abs=3 * 5.0 / 20.0)
    assert widths.common * 1e6 == pytest.approx(truth[1], rel=0.12)
    assert widths.individual * 1e6 == pytest.approx(truth[2], rel=0.06)


#: Widths of necks of rotation sensors, each at one or two places [um]: M. Ross, FlexureWidth,
#: Data/Batch 1 to 3; a line of 1.63 um, which is no neck, is omitted.
MEASURED = (
    "16.043 16.59, 13.467 13.048, 14.188, 14.974 14.91, 15.48 16.017, 12.779 13.255, 14.527 13.64",
    "16.78 15.557, 14.237 14.667, 21.617 21.542, 7.9883 16.485, 12.706 17.05, 14.508 13.676, "
    "17.024 14.44, 17.185 12.152",
    "13.596 11.927, 14.42 13.598, 19.613 8.51, 11.441 13.276, 7.01 17.55, 14.712 13.04, "
    "12.753 11.771",
)


def test_of_two_parts_with_one_mean_the_bias_is_known_twice_as_well(tmp_path: Path) -> None:
    rows = [f"{part},250,{230 + d}" for part in "ab" for d in (-2, 2)]
    widths = read_neck_widths(table(tmp_path, "part,drawn [um],measured [um]", *rows), STAGE)
    # their means do not differ: what is left is the scatter of four necks
    assert widths.individual == pytest.approx(8.0**0.5 * 1e-6)
    assert widths.common == pytest.approx(widths.individual / 2.0)


def test_public_records_scatter_as_the_manual_says(tmp_path: Path) -> None:
    found = []
    for batch in MEASURED:
        widths = [np.mean([float(x) for x in neck.split()]) for neck in batch.split(",")]
        rows = [f"14.5,{width:.4f}" for width in widths]
        path = table(tmp_path, "drawn [um],measured [um]", *rows)
        found.append(round(read_neck_widths(path, STAGE).individual * 1e6, 1))
    manual = (Path(__file__).parents[2] / "docs" / "how-to" / "tolerance.md").read_text()
    assert f"{found[0]}, {found[1]} and {found[2]} µm" in " ".join(manual.split())


def test_one_part_is_known_but_for_the_uncertainty_of_its_mean(tmp_path: Path) -> None:
    names = [h.name for h in STAGE.hinges]
    drawn = [h.profile.neck_thickness for h in STAGE.hinges]
    off = np.array([-21.0, -19.0, -20.5, -19.5])
    rows = [f"{n},{1e3 * t + 1e-3 * d:.6f} mm" for n, t, d in zip(names, drawn, off, strict=True)]
    path = table(tmp_path, "hinge,measured", *rows)
    widths = read_neck_widths(path, STAGE)
    assert widths.bias == pytest.approx(-20e-6)
    assert widths.individual == pytest.approx(np.std(off, ddof=1) * 1e-6)
    assert widths.common == pytest.approx(widths.individual / 2.0)
    thinner, scatter = widths.biased(STAGE), widths.scattered(Scatter(modulus=0.02))
    assert thinner.hinges[0].profile.neck_thickness == pytest.approx(drawn[0] - 20e-6)
    assert (scatter.neck_own, scatter.modulus) == (widths.individual, 0.02)

    request = ToleranceRequest(samples=200, of=("frequency",), model="lumped")
    plain = ready_tolerance(request, STAGE)(Workers(1), None)
    measured = ToleranceRequest(samples=200, of=("frequency",), model="lumped", widths=str(path))
    study = ready_tolerance(measured, STAGE)(Workers(1), None)
    # stiffness of notches goes with the power 5/2 of their thickness
    share = study.spreads[0].nominal / plain.spreads[0].nominal
    assert share == pytest.approx((1.0 - 20e-6 / drawn[0]) ** 1.25, rel=3e-3)
    assert study.spreads[0].standard_deviation < plain.spreads[0].standard_deviation
    assert "4 necks were measured, of one part" in study.notes[0]
    assert "thinner than drawn" in study.notes[0]


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        (("hinge,width",), "the header must have the columns"),
        (("hinge,measured [um]", "nobody,3"), "'nobody' is missing, or no hinge"),
        (("drawn [um],measured [um]", "250,wide"), "line 2: .*wide"),
        (("drawn,measured", "250,240"), "line 2: "),
        (("drawn [um],measured [mm]", "250,240"), "line 2: .*check the unit"),
        (("drawn [um],measured [um]", "250,240"), "at least two necks must"),
        (("part,drawn [um],measured [um]", "a,250,240"), "of part 'a' must"),
        (("drawn [um],measured [um]",), "at least two necks must"),
    ],
)
def test_wrong_tables_are_refused_in_a_sentence(
    tmp_path: Path, rows: tuple[str, ...], message: str
) -> None:
    with pytest.raises(ModelError, match=message):
        read_neck_widths(table(tmp_path, *rows), STAGE)


def test_the_scatter_of_necks_is_given_once(tmp_path: Path) -> None:
    path = table(tmp_path, "drawn [um],measured [um]", "250,240", "250,241")
    request = ToleranceRequest(widths=str(path), scatter=("neck_own=1 um",))
    with pytest.raises(ModelError, match="--widths gives the scatter of necks"):
        ready_tolerance(request, STAGE)


def test_a_bias_that_leaves_no_neck_is_refused(tmp_path: Path) -> None:
    widths = read_neck_widths(table(tmp_path, "drawn [mm],measured [mm]", "2,1", "2,1"), STAGE)
    with pytest.raises(ModelError, match="leaves nothing of hinge"):
        widths.biased(STAGE)


def test_simulated_stages_have_the_measured_necks(tmp_path: Path) -> None:
    necks = {h.name: h.profile.neck_thickness for h in STAGE.hinges}
    off = dict(zip(necks, (-23.0, -17.0, -21.0, -19.0), strict=True))
    rows = [f"{n},{1e3 * t + 1e-3 * off[n]:.6f} mm" for n, t in necks.items()]
    path = table(tmp_path, "hinge,measured", *rows)
    widths = read_neck_widths(path, STAGE)

    def thinner(made: Stage) -> np.ndarray:
        return np.array([h.profile.neck_thickness - necks[h.name] for h in made.hinges])

    thin, process = widths.biased(STAGE), widths.scattered(Scatter())
    parts = np.array([thinner(manufactured(thin, process, seed=seed)) for seed in range(64)])
    # bias within three standard deviations, and scatter of each neck about the mean of its part
    assert parts.mean() == pytest.approx(-20e-6, abs=0.75e-6)
    assert parts.var(axis=1, ddof=1).mean() ** 0.5 == pytest.approx(widths.individual, rel=0.16)
    for seed in (2, 3):
        built = as_built(STAGE, seed=seed, widths=widths)
        assert thinner(built.manufactured) == pytest.approx(parts[seed])
    exact = Scatter(neck_common=0.0, neck_own=0.0)
    drawn = as_built(STAGE, scatter=exact, widths=widths)
    assert thinner(drawn.manufactured) == pytest.approx(-20e-6)
    bridge = design("bridge")
    twin = virtual_stage(bridge, model="lumped", quiet=True, scatter=False, widths=widths)
    expected = modes(lumped_system(widths.biased(bridge)), drives="in place", count=1).omega[0]
    assert twin.model.omega.min() == pytest.approx(expected, rel=1e-6)
    request = TwinRequest(widths=str(path), seed=1)
    notes = simulated_controller(STAGE, request).device.stage.notes
    assert any("4 necks were measured" in note and "which its necks are" in note for note in notes)


def test_necks_of_published_frequencies_keep_them(tmp_path: Path) -> None:
    path = table(tmp_path, "drawn [um],measured [um]", "250,240", "250,241", "250,242")
    stage = design("vgtu-piezo")
    exact = Scatter(neck_common=0.0, neck_own=0.0, position=0.0, modulus=0.0)
    plain, measured = (
        as_built(stage, scatter=exact, widths=w) for w in (None, read_neck_widths(path, stage))
    )
    one, other = (modes(b.system, count=2).frequency_hz for b in (plain, measured))
    assert other == pytest.approx(one, rel=1e-4)
    assert any("in place of which necks meet the published" in note for note in measured.notes)


def test_a_study_measures_the_stage_with_its_necks(tmp_path: Path) -> None:
    path = table(tmp_path, "drawn [um],measured [um]", "250,220", "250,221", "250,219")
    request = StudyRequest(model=("lumped",), parts=("virtual",))

    def frequency(**more: object) -> float:
        rows = run_study(STAGE, request, **more).virtual.data()["characteristics"]
        (row,) = [r for r in rows if r["quantity"] == "natural_frequency_hz"]
        return row["value"]

    # stiffness of notches goes with the power 5/2 of their thickness
    share = (1.0 - 30e-6 / 500e-6) ** 1.25
    assert frequency(widths=str(path)) / frequency() == pytest.approx(share, rel=0.02)
