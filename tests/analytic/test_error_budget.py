"""The error budget of a rotary table against the exact geometry of heads on a scale."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from flexstage.base.errors import ModelError
from flexstage.centring import ARCSEC, exact_error
from flexstage.centring.error_budget import (
    allowed_eccentricity,
    code_limit,
    contributions,
    expanded_uncertainty,
    transmission_to_mean,
)
from flexstage.centring.table_file import (
    CodeTracks,
    Graduation,
    Heads,
    MountedScale,
    RotaryTable,
    RotationAxis,
    Tolerance,
    read_table,
    table_from_text,
)
from flexstage.centring.turns import code_faults
from flexstage.virtual import VirtualTable

THETA = 2.0 * np.pi * np.arange(3600) / 3600
ONE = (0.3,)
TABLE = RotaryTable(
    name="comparator",
    scale=MountedScale(radius=48e-3, eccentricity=50e-6),
    heads=Heads(angles=ONE),
    tolerance=Tolerance(error=1.0 * ARCSEC, reading="each"),
)


def amplitude(y: np.ndarray, order: int) -> float:
    return float(2.0 * abs(np.mean(y * np.exp(-1j * order * THETA))))


def read_by(angles: tuple[float, ...], kind: str = "disc", **of_scale) -> tuple[np.ndarray, ...]:
    centre = of_scale.pop("centre", (0.0, 0.0))
    heads = [exact_error(THETA, centre, 48e-3, head_angle=a, kind=kind, **of_scale) for a in angles]
    return heads[0], np.mean(heads, axis=0)


@pytest.mark.parametrize("angles", [ONE, (0.0, math.pi), tuple(np.radians([0, 50, 180, 230]))])
@pytest.mark.parametrize(
    ("kind", "scale", "of_scale"),
    [
        ("disc", {"eccentricity": 50e-6}, {"centre": (50e-6, 0.0)}),
        ("drum", {"eccentricity": 500e-6}, {"centre": (500e-6, 0.0)}),
        (
            "disc",
            {"eccentricity": 1e-12, "ellipticity": 2e-6},
            {"ellipticity": (2e-6 / 48e-3, 0.4)},
        ),
        ("disc", {"eccentricity": 1e-12, "tilt": 0.01}, {"tilt": (0.01, 0.4)}),
    ],
)
def test_each_cause_is_that_of_the_exact_geometry(kind, scale, of_scale, angles) -> None:
    described = replace(
        TABLE, scale=MountedScale(kind=kind, radius=48e-3, **scale), heads=Heads(angles=angles)
    )
    one, mean = read_by(angles, kind, **of_scale)
    rows = contributions(described, described.scale.eccentricity)
    assert {row.order for row in rows} <= {1, 2, 3}
    for row in rows:
        if row.each > 1e-9:
            assert row.each == pytest.approx(amplitude(one, row.order), rel=2e-3)
            assert row.mean == pytest.approx(amplitude(mean, row.order), rel=2e-3, abs=1e-12)


@pytest.mark.parametrize("angles", [ONE, (0.0, math.pi), tuple(np.radians([0, 50, 180, 230]))])
def test_a_motion_of_the_axis_reaches_the_mean_as_order_one(angles) -> None:
    # 0.4 um across the first head, twice a turn
    m = 0.4e-6 * np.cos(2.0 * THETA)
    motion = np.stack((m * np.sin(angles[0]), -m * np.cos(angles[0])), axis=1)
    read = [exact_error(THETA, (0.0, 0.0), 48e-3, head_angle=a, axis_motion=motion) for a in angles]
    described = replace(
        TABLE, heads=Heads(angles=angles), axis=RotationAxis(radial_synchronous=0.8e-6)
    )
    (row,) = (r for r in contributions(described, 1e-15) if "synchronous" in r.cause)
    assert row.each == pytest.approx(np.abs(read[0]).max(), rel=1e-3)
    # of the mean, the translation in the worst direction
    directions = np.linspace(0.0, 2.0 * np.pi, 361)
    at_rest = np.zeros(directions.size)
    worst = 0.4e-6 * np.stack((np.cos(directions), np.sin(directions)), axis=1)
    read = [
        exact_error(at_rest, (0.0, 0.0), 48e-3, head_angle=a, axis_motion=worst) for a in angles
    ]
    largest = np.abs(np.mean(read, axis=0)).max()
    # the square of m / R besides
    assert row.mean == pytest.approx(largest, rel=1e-3, abs=1e-10)


def test_the_simulated_table_moves_as_it_is_described() -> None:
    one = replace(
        TABLE,
        scale=replace(TABLE.scale, eccentricity=1e-12, ellipticity=3e-6),
        heads=Heads(angles=(0.5 * math.pi,)),
        axis=RotationAxis(radial_synchronous=0.8e-6),
    )
    still = replace(one, scale=replace(one.scale, ellipticity=0.0))
    (error,) = (c.values for c in VirtualTable.described(still).record().channels[1:])
    assert np.ptp(error) * 48e-3 == pytest.approx(0.8e-6, rel=1e-3)
    oval = replace(one, axis=RotationAxis())
    (error,) = (c.values for c in VirtualTable.described(oval).record().channels[1:])
    assert 0.5 * np.ptp(error) * 48e-3 == pytest.approx(3e-6, rel=1e-3)


def test_uncertain_angles_of_heads_leave_what_drawn_angles_leave() -> None:
    nominal, u = np.radians([0.0, 90.0, 180.0, 270.0]), 2e-3
    rng = np.random.default_rng(4)
    left = []
    for _ in range(400):
        angles = nominal + rng.normal(0.0, u, 4)
        read = [50e-6 / 48e-3 * np.sin(THETA[::20] + a) for a in angles]
        left.append(np.mean(read, axis=0))
    described = replace(TABLE, heads=Heads(angles=tuple(nominal), angle_uncertainty=u))
    (row,) = (r for r in contributions(described, 50e-6) if "uncertain" in r.cause)
    assert row.uncertainty("mean") == pytest.approx(np.sqrt(np.mean(np.square(left))), rel=0.06)
    assert row.uncertainty("each") == 0.0


def test_the_allowed_eccentricity_just_meets_the_tolerance() -> None:
    allowed = allowed_eccentricity(TABLE)
    # twice the rms value of a sine of one arcsec over R
    assert allowed == pytest.approx(48e-3 * ARCSEC / math.sqrt(2.0), rel=1e-5)
    assert expanded_uncertainty(TABLE, allowed) == pytest.approx(ARCSEC, rel=1e-5)
    limited = replace(TABLE, tolerance=Tolerance(error=ARCSEC, reading="each", eccentricity=0.1e-6))
    assert allowed_eccentricity(limited) == 0.1e-6
    opposite = replace(TABLE, heads=Heads(angles=(0.0, math.pi)), tolerance=Tolerance(error=ARCSEC))
    # two opposite heads leave order 2 alone, a tenth of a second of arc
    assert allowed_eccentricity(opposite) == 50e-6


def gray_codes(tracks: CodeTracks, eccentricity: float, angles: np.ndarray) -> np.ndarray:
    """Codes that sensors on a radial line read from a disc, one track for each bit."""
    radii = np.linspace(tracks.inner, tracks.outer, tracks.bits)
    code = np.zeros(angles.size, dtype=int)
    value = np.zeros(angles.size, dtype=int)
    # the innermost track is the coarsest
    for k, radius in enumerate(radii):
        line = angles + exact_error(angles, (eccentricity, 0.0), radius)
        counted = np.floor(line / tracks.step).astype(int) % 2**tracks.bits
        bit = ((counted ^ (counted >> 1)) >> (tracks.bits - 1 - k)) & 1
        value ^= bit  # of the binary number, from the top
        code = 2 * code + value
    return code


def test_gray_codes_follow_one_another_up_to_the_limit_of_their_tracks() -> None:
    tracks = CodeTracks(code="gray", bits=10, inner=20e-3, outer=40e-3)
    angles = 2.0 * np.pi * (np.arange(200_000) + 0.5) / 200_000

    def largest_jump(eccentricity: float) -> int:
        steps = np.diff(gray_codes(tracks, eccentricity, angles)) % 2**tracks.bits
        return int(np.minimum(steps, 2**tracks.bits - steps).max())

    assert largest_jump(0.0) == 1
    assert largest_jump(0.98 * code_limit(tracks)) == 1
    # the edges of the coarse tracks are not at the angle of the largest displacement
    assert largest_jump(1.4 * code_limit(tracks)) > 1


def test_a_code_limits_the_eccentricity_and_adds_its_step() -> None:
    tracks = CodeTracks(code="binary", bits=16, inner=30e-3, outer=48e-3)
    scale = replace(TABLE.scale, tracks=tracks)
    table = replace(TABLE, scale=scale, tolerance=Tolerance(error=0.01, reading="each"))
    step = 2.0 * math.pi / 2**16
    by_hand = 0.5 * step / (1.0 / 30e-3 - 1.0 / 48e-3)
    assert allowed_eccentricity(table) == pytest.approx(min(50e-6, by_hand), rel=1e-9)
    assert code_limit(tracks) == pytest.approx(by_hand, rel=1e-12)
    (row,) = (r for r in contributions(table, 0.0) if "code" in r.cause)
    assert row.uncertainty("each") == pytest.approx(step / math.sqrt(12.0), rel=1e-9)


def test_what_no_stage_can_mend_is_refused() -> None:
    scale = replace(TABLE.scale, graduation=(Graduation(order=5, amplitude=1e-5),))
    with pytest.raises(ModelError, match=r"no stage can mend it; .* 'graduation', 2.92"):
        allowed_eccentricity(replace(TABLE, scale=scale))


def test_even_heads_leave_the_multiples_of_their_number() -> None:
    for number in (2, 3, 4):
        angles = tuple(2.0 * np.pi * np.arange(number) / number)
        heads = replace(TABLE, heads=Heads(angles=angles))
        left = [k for k in range(1, 13) if transmission_to_mean(heads, k) > 0.5]
        assert left == list(range(number, 13, number))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ("eccentricity: 50 um", "eccentricity: 60 mm"),
        ("angles: [0 deg]", "angles: []"),
        ("radius: 48 mm", "radius: 48 mm, diameter: 90 mm"),
        ("error: 1 arcsec", "error: -1 arcsec"),
        ("error: 1 arcsec", "error: 1 um"),
        ("error: 1 arcsec", "errors: 1 arcsec"),
    ],
)
def test_an_impossible_table_is_refused_in_a_sentence(change, message) -> None:
    text = (
        "table: 1\nname: t\nscale: {radius: 48 mm, eccentricity: 50 um}\n"
        "heads: {angles: [0 deg]}\ntolerance: {error: 1 arcsec}\n"
    )
    assert table_from_text(text).scale.radius == 48e-3
    with pytest.raises(ModelError, match=r"^table.*\S") as refused:
        table_from_text(text.replace(change, message))
    assert "\n" not in str(refused.value)


def test_a_file_is_read(tmp_path: Path) -> None:
    path = tmp_path / "t.yaml"
    path.write_text(
        "table: 1\nname: t\nscale: {kind: drum, radius: 48 mm, eccentricity: 50 um}\n"
        "heads: {angles: [0 deg, 90 deg]}\naxis: {speed: 10 rpm}\ntolerance: {error: 1 arcsec}\n"
    )
    table = read_table(path)
    assert table.axis.speed == pytest.approx(10.0 * 2.0 * math.pi / 60.0)
    assert table.scale.kind == "drum"


def test_dead_and_doubled_codes_are_named_and_noise_is_not() -> None:
    rng = np.random.default_rng(3)
    number = 256
    theta = 2.0 * np.pi * rng.uniform(size=60 * number)
    # 40 um off at 48 mm, 0.03 of a step of noise
    line = theta + exact_error(theta, (40e-6, 0.0), 48e-3)
    line += rng.normal(0.0, 0.03 * 2.0 * np.pi / number, theta.size)
    codes = np.floor(line / (2.0 * np.pi) * number)
    assert code_faults(theta, codes, number) == []
    # three bits stuck in one place, and a code that also appears half a turn away
    stuck = np.where(
        (codes % number >= 40) & (codes % number < 48), np.floor(codes) // 8 * 8, codes
    )
    assert code_faults(theta, stuck, number) == [
        "7 codes of 256 are never read: 41, 42, 43, 44, 45, 46, 47",
        "1 code of 256 is read at two places: 40",
    ]
    twice = np.where(codes % number == 200, 72, codes)
    assert code_faults(theta, twice, number) == [
        "1 code of 256 is never read: 200",
        "1 code of 256 is read at two places: 72",
    ]
    assert code_faults(theta[: 2 * number], codes[: 2 * number], number) == []
