"""What lies between a command and the free displacement of a drive, and behind a probe."""

import numpy as np

from flexstage.export.diagram.builder import DiagramBuilder
from flexstage.export.model import DynamicModel, ModelDrive, ModelProbe
from flexstage.system import modes

_FORCE, _LENGTH = "N", "m"


def output_scale(model: DynamicModel, drive: ModelDrive) -> float:
    """Return the free displacement over the output of a drive's hysteresis.

    It is 1 but for a hysteresis that was identified from voltage to reading [m/unit].
    """
    if drive.hysteresis is None or drive.stiffness is None:
        return 1.0
    port = model.system.drive(drive.name)
    found = modes(model.system, drives="in place", count=None)
    kept = drive.modal_gain.size
    own = (drive.stiffness or 1.0) * (port.vector @ found.shapes[:, :kept])
    own = own / found.omega[:kept] ** 2
    at = int(np.argmax(np.abs(own)))
    scale = float(drive.modal_gain[at] / own[at])
    return 1.0 if abs(scale - 1.0) < 1e-9 else scale


def add_drive_chain(
    builder: DiagramBuilder, model: DynamicModel, drive: ModelDrive, group: str
) -> str:
    """Add what lies before the spring of a drive; return what gives w [m], or the force [N]."""
    what = "force" if drive.stiffness == 0.0 else "free displacement"
    unit = _FORCE if drive.stiffness == 0.0 else _LENGTH
    words = f"{what} of drive {drive.name} [{unit}]"
    at = builder.add(
        f"{group}_command",
        "input",
        f"u_{drive.name}",
        f"command of drive {drive.name} [{drive.unit}]",
        group=group,
        role="drive",
        unit=drive.unit,
    )
    signal = f"u_{drive.name} [{drive.unit}]"
    if drive.amplifier is not None:
        block = builder.add(
            f"{group}_amplifier",
            "amplifier",
            "amplifier",
            f"amplifier of drive {drive.name}, {drive.amplifier.bandwidth_hz:.4g} Hz [V]",
            group=group,
            model=drive.amplifier,
            role="drive",
        )
        builder.connect(at, block, signal)
        at, signal = block, f"v_{drive.name} [V]"
    if drive.hysteresis is not None:
        block = builder.add(
            f"{group}_hysteresis",
            "hysteresis",
            "hysteresis",
            f"hysteresis ({drive.hysteresis.kind}) from voltage [V] to {words}",
            group=group,
            model=drive.hysteresis,
            role="drive",
        )
        builder.connect(at, block, signal)
        at, signal = block, ""
        scale = output_scale(model, drive)
        if scale != 1.0:
            block = builder.add(
                f"{group}_scale",
                "gain",
                "c",
                f"{words} over what was identified",
                group=group,
                matrix=np.array([[scale]]),
                role="drive",
            )
            at = builder.chain(at, block)
    elif drive.gain != 1.0 or drive.unit != unit:
        block = builder.add(
            f"{group}_gain",
            "gain",
            "c",
            f"{what} over command of drive {drive.name} [{unit}/{drive.unit}]",
            group=group,
            matrix=np.array([[drive.gain]]),
            role="drive",
        )
        builder.connect(at, block, signal)
        at, signal = block, ""
    if drive.creep is not None:
        block = builder.add(
            f"{group}_creep",
            "creep",
            "creep",
            f"creep of the {words}, {100.0 * drive.creep.rate_per_decade:.3g} % a decade",
            group=group,
            model=drive.creep,
            role="drive",
        )
        at = builder.chain(at, block)
    return at


def add_probe_chain(
    builder: DiagramBuilder, probe: ModelProbe, source: str, group: str, signal: str = ""
) -> str:
    """Add what lies behind the true motion [m] at a probe: its sensor, and the output, returned."""
    at = source
    if probe.sensor is not None:
        block = builder.add(
            f"{group}_sensor",
            "sensor",
            "sensor",
            f"sensor of probe {probe.name}, without its noise [{probe.unit}]",
            group=group,
            model=probe.sensor,
        )
        builder.connect(at, block, signal)
        at, signal = block, ""
    out = builder.add(
        f"{group}_reading",
        "output",
        f"y_{probe.name}",
        f"reading of probe {probe.name} [{probe.unit}]",
        group=group,
        unit=probe.unit,
    )
    builder.connect(at, out, signal or f"y_{probe.name} [{probe.unit}]")
    return out
