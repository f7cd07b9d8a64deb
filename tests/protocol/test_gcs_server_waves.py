"""Segments of wave tables against their closed forms."""

import numpy as np
import pytest

from flexstage.instruments.pi.simulated.commands_tables import segment
from tests.gcs_device import opened, talk


def made(text, present=0):
    kind, *words = text.split()
    return segment(kind, words, present=present, room=10_000)


def test_sine_of_one_period_is_a_raised_cosine():
    k = np.arange(2000)
    expected = 5.0 + 10.0 * 0.5 * (1.0 - np.cos(2.0 * np.pi * k / 2000))
    np.testing.assert_allclose(made("SIN_P 2000 10 5 2000 0 1000"), expected, atol=1e-12)


def test_sine_with_its_centre_to_one_side_is_two_halves():
    values = made("SIN_P 70 -4 1 50 13 30")
    np.testing.assert_array_equal(values[:13], 1.0)
    np.testing.assert_array_equal(values[63:], 1.0)
    k = np.arange(50)
    turn = np.where(k < 30, np.pi * k / 30, np.pi + np.pi * (k - 30) / 20)
    np.testing.assert_allclose(values[13:63], 1.0 - 2.0 * (1.0 - np.cos(turn)), atol=1e-12)
    assert values[43] == -3.0


def test_start_point_of_a_full_sine_is_its_phase():
    np.testing.assert_allclose(
        made("SIN_P 360 3 0 360 77 180"), np.roll(made("SIN_P 360 3 0 360 0 180"), 77), atol=1e-12
    )


def test_line_has_constant_acceleration_at_its_ends_and_reaches_its_end():
    """The example of a manual: a line that falls by 40 from 50 with 650 samples to speed up."""
    values = made("LIN 3000 -40 50 3000 0 650")
    steps = np.diff(values)
    top = -40.0 / (3000 - 650)
    np.testing.assert_allclose(steps[650:2349], top, rtol=1e-9)
    # in the first 650 samples the speed grows in proportion to the time
    np.testing.assert_allclose(np.diff(steps[:650]), top / 650, rtol=1e-6)
    np.testing.assert_allclose(np.diff(steps[2351:]), -top / 650, rtol=1e-6)
    assert values[0] == 50.0
    # the end itself is the first sample of what follows
    assert values[-1] + 0.5 * top / 650 == pytest.approx(10.0, abs=1e-9)


def test_line_without_rounding_waits_before_and_stays_behind():
    np.testing.assert_allclose(
        made("LIN 9 8 1 4 3 0"), [1.0, 1.0, 1.0, 1.0, 3.0, 5.0, 7.0, 9.0, 9.0], atol=1e-12
    )


def test_ramp_goes_up_and_down():
    values = made("RAMP 12 6 -1 10 1 0 4")
    up = -1.0 + 6.0 * np.arange(4) / 4.0
    down = 5.0 - 6.0 * np.arange(6) / 6.0
    np.testing.assert_allclose(values, np.concatenate(([-1.0], up, down, [-1.0])), atol=1e-12)


def test_rounded_ramp_has_no_step_of_speed_beyond_its_acceleration():
    values = made("RAMP 1000 20 0 1000 0 100 600")
    closed = np.append(values, values[0])
    bend = np.abs(np.diff(closed, 2))
    assert bend.max() <= 20.0 / (400 - 100) / 100 * (1.0 + 1e-9)
    assert values.max() == 20.0


def test_points_are_what_is_given():
    np.testing.assert_array_equal(made("PNT 1 3 1.5 -2 .25e1"), [1.5, -2.0, 2.5])
    np.testing.assert_array_equal(made("PNT 11 2 7 8", present=10), [7.0, 8.0])
    np.testing.assert_array_equal(made("PNT 1 2 7 8", present=10), [7.0, 8.0])


def numbers(text):
    return [float(line) for line in text.split("END_HEADER \n")[1].split(" \n")]


def test_segments_are_replaced_and_appended():
    session = opened()
    talk(
        session,
        "WAV 1 X PNT 1 2 9 9\nWAV 1 X LIN 3 3 1 3 0 0\nWAV 1 & PNT 4 1 4\nwav 1 & pnt 1 1 5",
    )
    assert numbers(talk(session, "GWD? 1 5 1")[0]) == pytest.approx([1.0, 2.0, 3.0, 4.0, 5.0])
    assert numbers(talk(session, "GWD?")[0]) == pytest.approx([1.0, 2.0, 3.0, 4.0, 5.0])
    assert talk(session, "GWD? 1 6 1\nGWD? 0 1 1\nGWD? 2 0 1") == ("", [405, 405, 405])


def test_tables_share_their_memory():
    session = opened()
    assert talk(session, "WAV 1 X LIN 3000 1 0 10 0 0\nWAV 2 X LIN 2000 1 0 10 0 0")[1] == 0
    assert talk(session, "WAV 2 & PNT 1 1 0\nWAV 3 X PNT 1 1 0\nWAV 1 X LIN 3001 1 0 1 0 0") == (
        "",
        [403] * 3,
    )
    assert talk(session, "WCL 2\nWAV 1 & LIN 2000 1 0 10 0 0") == ("", 0)
    assert talk(session, "WAV 3 X PNT 1 1 0") == ("", [403])


def test_long_arrays_come_in_rows_without_loss():
    session = opened()
    values = np.sin(np.arange(4321)) * 50.0
    for first in range(0, 4321, 300):
        part = values[first : first + 300]
        words = " ".join(f"{v:.12g}" for v in part)
        session.feed(
            f"WAV 4 {'&' if first else 'X'} PNT {first + 1} {part.size} {words}\n".encode()
        )
    text = session.feed(b"GWD? 1 4321 4\n").decode()
    assert text.count("\n") == 4321 + 9
    # ten digits are sent
    np.testing.assert_allclose(numbers(text), values, rtol=1e-9)
