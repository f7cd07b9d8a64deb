"""What `flexstage centre` says: its JSON, and its tables."""

import math
from typing import TYPE_CHECKING, Any

from flexstage.cli.centre_heads import TURN_WORDS
from flexstage.cli.centre_setting import Setting
from flexstage.cli.common import console, make_table

if TYPE_CHECKING:
    from flexstage.centring import Eccentricity, Harmonic
    from flexstage.estimate import Estimate

__all__ = ["joined", "print_setting", "report"]

_ARCSEC = math.pi / 648_000.0


def report(
    setting: Setting, sign: int, mirror: float, mount: float, written: str | None
) -> dict[str, Any]:
    """Return what is said of one setting, as plain data.

    Parameters
    ----------
    setting : Setting
        What was found.
    sign : int
        -1 where errors are true angle less angle that was read.
    mirror : float
        -1 where the heads travel clockwise.
    mount : float
        Direction of the stage's x axis [rad].
    written : str or None
        Unit that harmonics are printed in.

    Returns
    -------
    dict
        Plain data.
    """
    radial = setting.heads[0].radial
    unit, factor = _written(written, "m" if radial else "rad")
    fit = setting.fits[0]
    out: dict[str, Any] = {
        "records": list(dict.fromkeys(h.file for h in setting.heads)),
        "unit": unit,
        "harmonics": [_harmonic(h, unit, factor, radial) for h in setting.harmonics],
        "offset": factor * fit.offset.value,
        "offset_uncertainty": factor * fit.offset.uncertainty,
        "residual_rms": factor
        * math.sqrt(sum(f.residual_rms**2 for f in setting.fits) / len(setting.fits)),
        "turns": fit.turns,
        "samples": sum(f.samples for f in setting.fits),
        "noise": fit.noise,
        "outliers": [
            {
                "head": h.name,
                "index": o.index,
                "angle_deg": math.degrees(o.angle) % 360.0,
                "value": factor * o.value,
                "residual": factor * o.residual,
                "unit": unit,
            }
            for h, f in zip(setting.heads, setting.fits, strict=True)
            for o in f.outliers
        ],
        "heads": [
            {
                "column": h.name,
                "file": h.file,
                "angle_deg": mirror * math.degrees(h.head_angle),
                "harmonics": [_harmonic(own, unit, factor, radial) for own in f.harmonics],
                "offset": factor * f.offset.value,
                "residual_rms": factor * f.residual_rms,
            }
            for h, f in zip(setting.heads, setting.fits, strict=True)
        ],
        "notes": list(setting.notes),
    }
    if setting.centre is not None:
        out |= _centred(setting.centre, sign, mirror, mount)
    return out


def _written(text: str | None, si: str) -> tuple[str, float]:
    """Return the unit that is printed, and how many of it the SI unit is."""
    if text is None:
        return si, 1.0
    if text.strip().lower() in TURN_WORDS:
        return "turn", 0.5 / math.pi
    from flexstage.units import si_unit

    factor, known = si_unit(text)
    return (text, 1.0 / factor) if known == si else (si, 1.0)


def _harmonic(h: "Harmonic", unit: str, factor: float, radial: bool) -> dict[str, Any]:
    low, high = h.amplitude.interval()
    return {
        "order": h.order,
        "amplitude": factor * h.amplitude.value,
        "amplitude_uncertainty": factor * h.amplitude.uncertainty,
        "amplitude_interval": [factor * low, factor * high],
        "cosine": factor * h.cosine.value,
        "sine": factor * h.sine.value,
        "phase_deg": math.degrees(h.phase.value),
        "unit": unit,
        "amplitude_arcsec": None if radial else h.amplitude.value / _ARCSEC,
        "amplitude_um": 1e6 * h.amplitude.value if radial else None,
    }


def _centred(found: "Eccentricity", sign: int, mirror: float, mount: float) -> dict[str, Any]:
    # the other sign is the opposite place, and the other sense has y the other way
    x, y = sign * found.x.value, sign * mirror * found.y.value
    c, s = math.cos(mount), math.sin(mount)
    xx, yy = found.covariance[0, 0], found.covariance[1, 1]
    xy = mirror * found.covariance[0, 1]
    low, high = found.amplitude.interval()
    return {
        "eccentricity": {
            "value": found.amplitude.value,
            "x": x,
            "y": y,
            "phase_deg": math.degrees(math.atan2(y, x)),
            "uncertainty": found.amplitude.uncertainty,
            "uncertainty_x": found.x.uncertainty,
            "uncertainty_y": found.y.uncertainty,
            "uncertainty_phase_deg": math.degrees(found.phase.uncertainty),
            "interval": [low, high],
            "unit": "m",
        },
        "move": {
            "x": -(c * x + s * y),
            "y": -(-s * x + c * y),
            "uncertainty_x": math.sqrt(max(c * c * xx + 2.0 * c * s * xy + s * s * yy, 0.0)),
            "uncertainty_y": math.sqrt(max(s * s * xx - 2.0 * c * s * xy + c * c * yy, 0.0)),
            "mount_angle_deg": math.degrees(mount),
            "unit": "m",
        },
        "reference_error": _plain(found.common),
        "counter_motion": _plain(found.counter_motion),
    }


def _plain(estimate: "Estimate | None") -> dict[str, Any] | None:
    if estimate is None:
        return None
    low, high = estimate.interval()
    return {
        "value": estimate.value,
        "uncertainty": estimate.uncertainty,
        "interval": [low, high],
        "unit": estimate.unit,
    }


def joined(reports: list[dict[str, Any]], notes: tuple[str, ...]) -> dict[str, Any]:
    """Return the last setting, with all of them where there are several.

    Parameters
    ----------
    reports : list of dict
        What is said of each.
    notes : tuple of str
        Notes on the files.

    Returns
    -------
    dict
        Plain data.
    """
    last = dict(reports[-1])
    last["notes"] = [*last["notes"], *notes]
    if len(reports) > 1:
        last["settings"] = reports
    return last


def print_setting(result: dict[str, Any]) -> None:
    """Print what is said of one setting.

    Parameters
    ----------
    result : dict
        Plain data, as of `report`.
    """
    screen = console()
    shown = [h["amplitude_um"] for h in result["harmonics"]]
    radial = bool(shown) and shown[0] is not None
    unit = "µm" if radial else "arcsec"
    key = "amplitude_um" if radial else "amplitude_arcsec"
    table = make_table(
        f"harmonics: {', '.join(result['records'])}",
        "order",
        f"amplitude, {unit}",
        "95 % interval",
        "phase, deg",
    )
    for h in result["harmonics"]:
        per = h[key] / h["amplitude"] if h["amplitude"] else 0.0
        low, high = (per * end for end in h["amplitude_interval"])
        table.add_row(
            str(h["order"]), f"{h[key]:.5g}", f"{low:.4g} to {high:.4g}", f"{h['phase_deg']:.2f}"
        )
    screen.print(table)
    screen.print(
        f"{result['samples']} samples over {result['turns']:.2f} turns; left over "
        f"{result['residual_rms']:.4g} {result['unit']} rms"
    )
    if "eccentricity" in result:
        _print_centre(result["eccentricity"], result["move"])
    for o in result["outliers"][:20]:
        screen.print(
            f"outlier: sample {o['index']} of '{o['head']}' at {o['angle_deg']:.2f} deg is "
            f"{o['residual']:.4g} {o['unit']} off",
            style="yellow",
            markup=False,
        )
    if len(result["outliers"]) > 20:
        screen.print(f"and {len(result['outliers']) - 20} more", style="yellow", markup=False)
    for note in result["notes"]:
        screen.print(f"note: {note}", style="dim", markup=False)


def _print_centre(found: dict[str, Any], move: dict[str, Any]) -> None:
    low, high = (1e6 * end for end in found["interval"])
    screen = console()
    screen.print(
        f"eccentricity {1e6 * found['value']:.4f} µm ({low:.4f} to {high:.4f}), in the direction "
        f"{found['phase_deg']:.2f} deg"
    )
    screen.print(
        f"move of the stage: x {1e6 * move['x']:+.4f} ± {1e6 * move['uncertainty_x']:.4f} µm, "
        f"y {1e6 * move['y']:+.4f} ± {1e6 * move['uncertainty_y']:.4f} µm (standard uncertainty)"
    )
