"""The structural diagram of one axis: masses, springs, dampers and a lever, as one draws them."""

from dataclasses import dataclass

import numpy as np

from flexstage.export.diagram.axis_chain import AxisChain
from flexstage.export.diagram.builder import DiagramBuilder
from flexstage.export.diagram.drive_chain import add_drive_chain, add_probe_chain
from flexstage.export.diagram.graph import Diagram
from flexstage.export.diagram.springs import DriveSpring
from flexstage.export.model import DynamicModel, ModelDrive, ModelProbe
from flexstage.system import RayleighDamping


@dataclass(frozen=True, slots=True, kw_only=True)
class _Mass:
    """What other groups connect to."""

    forces: str
    rate: str
    motion: str
    letter: str


def axis_blocks(
    model: DynamicModel,
    drive: ModelDrive,
    probe: ModelProbe,
    chain: AxisChain,
    *,
    spring: DriveSpring,
    damping: RayleighDamping,
    title: str,
    notes: tuple[str, ...],
) -> Diagram:
    """Return the diagram of an axis."""
    b = DiagramBuilder()
    group = b.group("drive", title=f"Drive {drive.name} ({drive.kind})", kind="drive")
    free = add_drive_chain(b, model, drive, group)
    two = chain.output_mass > 0.0
    head = _mass(
        b,
        "input",
        "Input" if two else "Stage",
        "d",
        chain.input_mass,
        damping.alpha * chain.input_mass + damping.beta * chain.input_stiffness,
        chain.input_stiffness,
    )
    force = free
    if spring.stiffness > 0.0:
        force = _drive_spring(b, drive, spring, damping, free, head, group)
    b.term(head.forces, force, 1, "F [N]")
    read = _transmission(b, chain, damping, head).motion if two else head.motion
    probe_group = b.group("probe", title=f"Probe {probe.name}", kind="probe")
    if not two:
        lever = _gain(
            b, "probe_ratio", "i", chain.ratio, f"ratio of reading to drive {drive.name} [1]",
            probe_group, "geometry",
        )  # fmt: skip
        b.connect(read, lever, "d [m]")
        read = lever
    add_probe_chain(b, probe, read, probe_group, "p [m]" if two else "")
    return b.diagram(title, notes)


def _gain(
    b: DiagramBuilder, name: str, label: str, value: float, meaning: str, group: str, role: str
) -> str:
    return b.add(name, "gain", label, meaning, group=group, matrix=np.array([[value]]), role=role)


def _mass(
    b: DiagramBuilder,
    name: str,
    title: str,
    letter: str,
    mass: float,
    damper: float,
    stiffness: float,
) -> _Mass:
    """Add a mass, with a spring and a damper to the ground."""
    low = title.lower()
    # one mass alone needs no mark
    short = {"Input": "_in", "Output": "_out"}.get(title, "")
    group = b.group(name, title=f"{title} mass", kind="body")
    forces = b.add(f"{name}_forces", "sum", "+", f"forces on the {low} [N]", group=group)
    inverse = _gain(
        b, f"{name}_inverse_mass", f"1/m{short}", 1.0 / mass, f"inverse mass of the {low} [1/kg]",
        group, "mass",
    )  # fmt: skip
    rate = b.add(
        f"{name}_rate", "integrator", "1/s", f"speed of the {low} {letter}' [m/s]", group=group
    )
    motion = b.add(
        f"{name}_motion", "integrator", "1/s", f"motion of the {low} {letter} [m]", group=group
    )
    b.chain(forces, inverse, rate, motion)
    if damper > 0.0:
        drag = _gain(
            b, f"{name}_damper", f"c{short}", damper,
            f"damper between the {low} and the ground [N s/m]", group, "damper",
        )  # fmt: skip
        b.connect(rate, drag)
        b.term(forces, drag, -1, last=True)
    if stiffness > 0.0:
        hold = _gain(
            b, f"{name}_spring", f"k{short}", stiffness,
            f"spring between the {low} and the ground [N/m]", group, "spring",
        )  # fmt: skip
        b.connect(motion, hold)
        b.term(forces, hold, -1, last=True)
    return _Mass(forces=forces, rate=rate, motion=motion, letter=letter)


def _drive_spring(
    b: DiagramBuilder,
    drive: ModelDrive,
    spring: DriveSpring,
    damping: RayleighDamping,
    free: str,
    head: _Mass,
    group: str,
) -> str:
    """Add the spring of a drive between its free displacement and the input; return its force."""
    stretch = b.add(
        "drive_compression", "sum", "+", f"compression of drive {drive.name} [m]", group=group
    )
    b.term(stretch, free, 1, f"w_{drive.name} [m]")
    b.term(stretch, head.motion, -1, "d [m]")
    words = "stiff spring in place of an imposed displacement" if spring.stands_in else "stiffness"
    stiffness = _gain(
        b, "drive_spring", "k_s", spring.stiffness, f"{words} of drive {drive.name} [N/m]", group,
        "spring",
    )  # fmt: skip
    b.connect(stretch, stiffness)
    if spring.stands_in or damping.beta == 0.0:
        return stiffness
    damper = _gain(
        b, "drive_damper", "c_s", damping.beta * spring.stiffness,
        f"damping of drive {drive.name} [N s/m]", group, "damper",
    )  # fmt: skip
    b.connect(head.rate, damper, "d' [m/s]")
    force = b.add("drive_force", "sum", "+", f"force of drive {drive.name} [N]", group=group)
    b.term(force, stiffness, 1)
    b.term(force, damper, -1)
    return force


def _transmission(
    b: DiagramBuilder, chain: AxisChain, damping: RayleighDamping, head: _Mass
) -> _Mass:
    """Add lever, spring and damper between the input and the output, and the output mass."""
    group = b.group("transmission", title="Transmission: lever and spring", kind="hinge")
    tail = _mass(
        b, "output", "Output", "p", chain.output_mass, damping.alpha * chain.output_mass, 0.0
    )
    stretch = b.add(
        "transmission_deformation", "sum", "+", "deformation of the transmission i d - p [m]",
        group=group,
    )  # fmt: skip
    words = "ratio of the lever [1]"
    lever = _gain(b, "transmission_motion_ratio", "i", chain.ratio, words, group, "geometry")
    b.connect(head.motion, lever, "d [m]")
    b.term(stretch, lever, 1)
    b.term(stretch, tail.motion, -1, "p [m]")
    force = _gain(
        b, "transmission_spring", "k_t", chain.transmission_stiffness,
        "stiffness of the transmission [N/m]", group, "spring",
    )  # fmt: skip
    b.connect(stretch, force)
    if damping.beta > 0.0:
        rate = b.add(
            "transmission_rate", "sum", "+", "rate of deformation i d' - p' [m/s]", group=group
        )
        speed = _gain(b, "transmission_rate_ratio", "i", chain.ratio, words, group, "geometry")
        b.connect(head.rate, speed, "d' [m/s]")
        b.term(rate, speed, 1)
        b.term(rate, tail.rate, -1, "p' [m/s]")
        damper = _gain(
            b, "transmission_damper", "c_t", damping.beta * chain.transmission_stiffness,
            "damping of the transmission [N s/m]", group, "damper",
        )  # fmt: skip
        b.connect(rate, damper)
        spring, force = (
            force,
            b.add("transmission_force", "sum", "+", "force of the transmission [N]", group=group),
        )
        b.term(force, spring, 1)
        b.term(force, damper, 1)
    back = _gain(b, "transmission_back", "i", chain.ratio, words, group, "geometry")
    b.connect(force, back, "f [N]")
    b.term(head.forces, back, -1, "i f [N]")
    b.term(tail.forces, force, 1, "f [N]")
    return tail
