"""One stage of a lot by the single analysis: notches, masses and matrices built by themselves."""

import math
from collections.abc import Mapping
from dataclasses import fields, replace

import numpy as np

from flexstage.hinges import compliance, stress_rows
from flexstage.hinges.registry import with_neck_radius, with_neck_thickness
from flexstage.lumped import hinge_springs, lumped_system
from flexstage.lumped.assemble import (
    BodyCoordinates,
    _elongation,
    _probe_port,
    _weight,
    hinge_matrix,
    point_matrix,
)
from flexstage.stage import Circle, PiezoStack, Stage, mass_properties
from flexstage.system import MechanicalSystem, analyse
from flexstage.system.mechanical import BodyPort, LoadPort, drive_port
from flexstage.system.stress_map import StressMap
from flexstage.virtual.imperfections import Scatter


def made_stage(stage: Stage, scatter: Scatter, numbers: Mapping[str, np.ndarray], i: int = 0):
    """Return a stage with the deviations of sample i, and its notches where they came to lie.

    Its outlines are those of the drawing, larger with the temperature; so its necks may be off the
    edges that they grew from, by micrometres.
    """

    def off(kind: str, of: int, each: int = 0) -> float:
        return (
            getattr(scatter, kind) * float(numbers[kind][i, of, each]) if kind in numbers else 0.0
        )

    longer = 1.0 + (stage.material.thermal_expansion or 0.0) * off("temperature", 0)

    def place(at):
        return (longer * at[0], longer * at[1])

    def scaled(loop):
        if isinstance(loop, Circle):
            return replace(loop, centre=place(loop.centre), radius=longer * loop.radius)
        return loop.mapped(place)

    hinges, moved = [], []
    for h, hinge in enumerate(stage.hinges):
        neck = hinge.profile.neck_thickness + off("neck_common", 0) + off("neck_own", h)
        profile = with_neck_thickness(with_neck_radius(hinge.profile, off("radius", h)), neck)
        # every length of a notch grows alike
        larger = profile if longer == 1.0 else _larger(profile, longer)
        hinges.append(replace(hinge, profile=larger, at=place(hinge.at)))
        at = (hinge.at[0] + off("position", h, 0), hinge.at[1] + off("position", h, 1))
        moved.append(place(at))
    drives = []
    for d, drive in enumerate(stage.drives):
        side = off("drive", d)
        x, y = drive.at[0]
        c, s = math.cos(drive.direction), math.sin(drive.direction)
        changed = {"at": (place((x - side * s, y + side * c)), place(drive.at[1]))}
        if isinstance(drive, PiezoStack):
            changed["free_stroke"] = drive.free_stroke * (1.0 + off("stroke", d))
        drives.append(replace(drive, **changed))
    material = stage.material
    made = replace(
        stage,
        thickness=longer * (stage.thickness + off("thickness", 0)),
        material=replace(
            material,
            youngs_modulus=material.youngs_modulus * (1.0 + off("modulus", 0)),
            density=material.density * (1.0 + off("density", 0)) / longer**3,
        ),
        bodies=tuple(
            replace(
                body,
                outline=scaled(body.outline),
                holes=tuple(map(scaled, body.holes)),
                mounting_holes=tuple(map(scaled, body.mounting_holes)),
                extra_masses=tuple(
                    replace(m, at=place(m.at), inertia=m.inertia * longer**2)
                    for m in body.extra_masses
                ),
            )
            for body in stage.bodies
        ),
        hinges=tuple(hinges),
        drives=tuple(drives),
        probes=tuple(replace(probe, at=place(probe.at)) for probe in stage.probes),
    )
    return made, moved, longer


def _larger(profile, factor: float):
    lengths = {
        f.name: factor * getattr(profile, f.name)
        for f in fields(profile)
        if f.name not in ("one_sided", "half_opening_angle", "exponent")
    }
    return replace(profile, **lengths)


def made_system(
    stage: Stage, scatter: Scatter, numbers: Mapping[str, np.ndarray], i: int = 0
) -> tuple[Stage, MechanicalSystem]:
    """Return the stage of sample i and its lumped model, each notch computed for itself."""
    made, moved, longer = made_stage(stage, scatter, numbers, i)
    masses = mass_properties(made)
    free = tuple(b.name for b in made.bodies if not b.fixed)
    layout = BodyCoordinates({name: p.centre for name, p in masses.items()}, free)
    mass = np.concatenate([(p.mass, p.mass, p.inertia) for p in (masses[n] for n in free)])
    K = np.zeros((layout.order, layout.order))
    rows, owner = [], []
    for h, (spring, hinge) in enumerate(zip(hinge_springs(stage), made.hinges, strict=True)):
        roots = tuple(longer * w for w in spring.root_widths)
        k = compliance(
            hinge.profile,
            made.material.youngs_modulus,
            made.material.poissons_ratio,
            made.thickness,
            plane=spring.plane,
            root_widths=roots,
        ).stiffness
        b = hinge_matrix(layout, replace(hinge, at=moved[h]))
        K += b.T @ k @ b
        stress = stress_rows(
            hinge.profile, made.thickness, made.material.poissons_ratio, spring.plane
        )
        rows.append(stress @ k @ b)
        owner += [h] * len(stress)
    drawn = lumped_system(stage)
    bodies = tuple(
        BodyPort(name=n, centre=p.centre, matrix=point_matrix(layout, n, p.centre))
        for n, p in masses.items()
    )
    return made, replace(
        drawn,
        M=np.diag(mass),
        K=0.5 * (K + K.T),
        drives=tuple(drive_port(d, _elongation(layout, d), bodies) for d in made.drives),
        probes=tuple(_probe_port(layout, p) for p in made.probes),
        bodies=bodies,
        stress=StressMap(
            hinges=tuple(h.name for h in made.hinges),
            matrix=np.concatenate(rows),
            owner=np.array(owner, dtype=np.intp),
        ),
        loads=tuple(
            LoadPort(name=f"gravity {axis}", vector=_weight(layout, mass, j), unit="g")
            for j, axis in enumerate("xy")
        ),
    )


def single_figures(stage, scatter, numbers, i=0) -> dict[tuple[str, str], float]:
    """Return the figures of sample i by the single analysis."""
    made, system = made_system(stage, scatter, numbers, i)
    return {(c.quantity, c.axis): c.value for c in analyse(made, system).characteristics}
