"""What `flexstage frf` finds, as plain data, as a record and as people read it."""

from typing import TYPE_CHECKING, Any

from flexstage.cli.output import print_notes, print_table
from flexstage.files.plain import picked

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.console import Console

    from flexstage.estimate import Estimate
    from flexstage.measure.frf import FrfResult
    from flexstage.measure.modal.ring_down import RingDown
    from flexstage.measure.spectra.response import MeasuredResponse
    from flexstage.records import Record


#: Share of a response beyond which what a fit leaves says that its modes are none of it.
_NO_FIT = 0.5


def response_record(response: "MeasuredResponse", read: "Sequence[Record]") -> "Record":
    """Return a response as columns, for other programs.

    Frequency; real and imaginary part, variance and coherence as far as they are known, and by how
    much a window has mixed neighbouring lines.
    """
    import numpy as np

    from flexstage.records import Channel, Record

    channels = [Channel(name="frequency", values=response.frequency_hz, unit="Hz")]
    for o, name in enumerate(response.outputs):
        for i, other in enumerate(response.inputs):
            h = response.response[:, o, i]
            label = f"{name}/{other}"
            unit = _quotient(response, o, i)
            channels += [
                Channel(name=f"{label} real", values=h.real.copy(), unit=unit),
                Channel(name=f"{label} imaginary", values=h.imag.copy(), unit=unit),
            ]
            if response.variance is not None:
                channels.append(
                    Channel(name=f"{label} variance", values=response.variance[:, o, i].copy())
                )
        if response.coherence is not None:
            channels.append(
                Channel(name=f"{name} coherence", values=response.coherence[:, o].copy())
            )
    if response.blur:
        blur = np.full(response.frequency_hz.size, response.blur)
        channels.append(Channel(name="blur", values=blur))
    return Record(
        channels=tuple(channels),
        time=np.arange(response.frequency_hz.size, dtype=np.float64),
        source=", ".join(r.source for r in read),
        notes=response.notes,
        over="point",
    )


def _quotient(response: "MeasuredResponse", o: int, i: int) -> str:
    """Return the unit of a response; empty where that of output or input is not known."""
    if not response.output_units or not response.input_units:
        return ""
    above, below = response.output_units[o], response.input_units[i]
    if not above or not below:
        return ""
    return f"{above}/({below})" if "/" in below else f"{above}/{below}"


def response_result(result: "FrfResult") -> dict[str, Any]:
    """Return a response and its modes as plain data."""
    response, estimate, found = result.response, result.estimate, result.fit
    notes = list(response.notes)
    if estimate is not None:
        notes += estimate.notes
    said: dict[str, Any] = {
        "records": [r.source for r in result.records],
        **picked(response, "inputs", "outputs", "estimator"),
        "excitation": "" if estimate is None else estimate.excitation,
        "averages": response.averages,
        "lines": int(response.frequency_hz.size),
        "frequency_range_hz": [float(response.frequency_hz[0]), float(response.frequency_hz[-1])],
        "modes": [],
    }
    if found is not None:
        said["band_hz"] = list(found.band)
        said["modes"] = [mode_result(mode, list(found.outputs)) for mode in found.modes]
        said["reduced_chi_squared"] = found.reduced_chi_squared
        for name in ("delay", "lag"):
            estimated = getattr(found, name)
            if estimated is not None:
                said[name] = _estimate(estimated)
        unlike = max(float(one.residual_rms.max()) for one in found.fitted)
        first = 1 if found.modes and unlike > _NO_FIT else 0
        said["warnings"] = list(found.notes[:first])
        notes += found.notes[first:]
    said["notes"] = list(dict.fromkeys(notes))
    return said


def decay_result(read: "Sequence[Record]", found: "RingDown") -> dict[str, Any]:
    """Return the modes of a free decay as plain data."""
    return {
        "records": [r.source for r in read],
        "modes": [mode_result(mode, list(found.channels)) for mode in found.modes],
        "notes": list(found.notes),
    }


def mode_result(mode: Any, outputs: list[str]) -> dict[str, Any]:
    """Return a mode as plain data."""
    import numpy as np

    return {
        "frequency_hz": _estimate(mode.frequency_hz),
        "damping_ratio": _estimate(mode.damping_ratio),
        "shape": [
            {
                "output": name,
                "real": float(value.real) if np.isfinite(value) else None,
                "imaginary": float(value.imag) if np.isfinite(value) else None,
            }
            for name, value in zip(outputs, mode.shape, strict=True)
        ],
    }


def _estimate(estimate: "Estimate") -> dict[str, Any]:
    names = "value", "uncertainty", "degrees_of_freedom", "interval", "unit"
    return picked(estimate, *names)


def print_modes(screen: "Console", result: dict[str, Any]) -> None:
    """Print the modes, how the response was estimated, notes and files."""
    for warning in result.get("warnings", ()):
        screen.print(f"warning: {warning}", style="bold", markup=False)
    rows = []
    for i, mode in enumerate(result["modes"], start=1):
        f, zeta = mode["frequency_hz"], mode["damping_ratio"]
        shape = ", ".join(
            f"{s['output']} {s['real']:+.3f}" for s in mode["shape"] if s["real"] is not None
        )
        (low, high), (least, most) = f["interval"], zeta["interval"]
        frequency = (f"{f['value']:.4f}", f"{0.5 * (high - low):.2g}")
        damping = (f"{100.0 * zeta['value']:.4f}", f"{50.0 * (most - least):.2g}")
        rows.append((i, *frequency, *damping, shape.replace("-", "−")))
    heads = "mode", "frequency [Hz]", "± (95 %)", "damping ratio [%]", "± (95 %)", "<shape"
    print_table(screen, f"modes: {', '.join(result['records'])}", heads, rows)
    if "averages" in result:
        averages = f"{result['averages']:g} averages, " if result["averages"] else ""
        kind = f"{result['excitation']}, " if result["excitation"] else ""
        screen.print(f"{kind}{result['estimator']} {averages}{result['lines']} lines".strip())
    for name in ("delay", "lag"):
        if name in result:
            value, u = result[name]["value"], result[name]["uncertainty"]
            screen.print(f"{name} {value:.4g} s, standard uncertainty {u:.2g} s")
    print_notes(screen, result["notes"], result["files"])
