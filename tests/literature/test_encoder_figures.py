"""Encoders: figures that others printed of eccentricity, of tilt, and of errors they measured.

- What 0.1 mm of eccentricity makes of the magnetic rings of two drives, in arcsec and deg
  (Synapticon, documentation 4.19.0 of 2022, SOMANET Circulo 7 and 9, page 117; not under an open
  licence: its figures are quoted alone).
- Errors of an optical encoder of 19 bit at 24 angles, turned forwards and backwards (Geng, Cao,
  Shang and Ding 2024, Sensors 24, 1400, Table 6; CC BY 4.0). Its abstract has an accuracy of 2.57
  arcsec, which is the root mean square of all 48.
- An artefact between whose faces is the angle A, on a mount with the tilt t: an angle that begins
  at the position P is wrong by a coefficient times t^2 sin A cos(A + 2 P), for tilts below 1 deg,
  and right at some P (Tilt effects in optical angle measurements, Journal of Research of NIST,
  abstract, PMC8345264, a work of the United States government). The coefficient is in the text,
  which was not available: projected on a plane, a circle gives 1/2.

None has an eccentricity that was changed by known amounts.

Evidence (Measuring and centring): encoders: eccentricity of four rings (Synapticon), accuracy of
one at 24 angles (Geng et al. 2024): last digit; form of the error by tilt (NIST): $10^{-4}$
"""

import numpy as np
import pytest

from flexstage.centring import ARCSEC, HeadReadings, eccentricity, exact_error, fit_harmonics

THETA = np.radians(np.arange(0.0, 360.0, 3.0))
#: Errors [arcsec] at 0, 15, ..., 345 deg.
FORWARDS = (
    0.0, 2.5, 3.1, -2.4, 2.3, -1.2, 2.3, 3.4, 2.2, -1.9, 1.6, 2.5,
    -1.8, 2.1, 3.5, -2.4, 2.6, 3.1, -2.6, 2.7, 3.9, -2.6, 3.1, 2.2,
)  # fmt: skip
BACKWARDS = (
    0.0, 3.2, 2.6, -2.5, -1.8, 3.1, -2.6, 3.7, 2.0, 2.4, -3.5, 1.9,
    -2.2, 1.8, 2.3, -1.6, -2.1, 3.2, -2.8, 3.4, 3.2, 2.6, -1.2, 3.3,
)  # fmt: skip


@pytest.mark.parametrize(
    ("radius", "arcsec", "degrees"),
    [(14.975, 1377, 0.38), (22.875, 902, 0.25), (24.975, 826, 0.23), (32.475, 635, 0.18)],
)
def test_rings_that_are_a_tenth_of_a_millimetre_off(radius, arcsec, degrees) -> None:
    turn = np.radians(np.arange(0.0, 360.0, 0.01))
    for kind in ("disc", "drum"):
        peak = np.abs(exact_error(turn, (0.1e-3, 0.0), 1e-3 * radius, kind=kind)).max()
        assert round(peak / ARCSEC) == arcsec
        assert round(np.degrees(peak), 2) == degrees
    # and back: half a unit of the last digit is 0.08 um or less
    readings = HeadReadings(angle=THETA, error=arcsec * ARCSEC * np.sin(THETA - 0.5))
    found = eccentricity(readings, radius=1e-3 * radius, kind="drum")
    assert found.amplitude.value == pytest.approx(0.1e-3, abs=0.5 * ARCSEC * 1e-3 * radius)
    assert found.phase.value == pytest.approx(0.5, abs=1e-6)


def test_accuracy_of_a_measured_encoder() -> None:
    angle = np.radians(15.0 * np.concatenate((np.arange(24), np.arange(23, -1, -1))))
    fit = fit_harmonics(angle, (*FORWARDS, *BACKWARDS[::-1]), orders=11, unit="arcsec")
    assert not fit.outliers
    square = fit.offset.value**2 + np.mean(fit.residual**2)
    square += sum(0.5 * h.amplitude.value**2 for h in fit.harmonics)
    assert round(float(np.sqrt(square)), 2) == 2.57


def test_angles_on_a_tilted_mount() -> None:
    tilt, about = np.radians(0.9), 0.4
    between, position = np.meshgrid(np.radians([15.0, 45.0, 100.0, 170.0]), THETA)

    def seen(angle):
        return exact_error(angle + about, (0.0, 0.0), 50e-3, tilt=(tilt, about))

    wrong = seen(position + between) - seen(position)
    form = tilt**2 * np.sin(between) * np.cos(between + 2.0 * position)
    coefficient = np.sum(wrong * form) / np.sum(form**2)
    # what the form leaves out is of the order tilt**4, and the square of 0.9 deg is 2.5e-4
    assert np.abs(wrong - coefficient * form).max() < 1e-4 * tilt**2
    assert coefficient == pytest.approx(0.5, rel=1e-3)
    still = 0.5 * (0.5 * np.pi - between)
    assert np.abs(seen(still + between) - seen(still)).max() < 1e-4 * tilt**2
