"""The two stages as they were reconstructed for this project, before this code."""

import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from flexstage.hinges import RightCircular
from flexstage.quantities.material import material
from flexstage.stage import Body, Circle, Hinge, Loop, Probe, Screw, Stage

REFERENCE = Path(__file__).parent / "reference"
NAMES = ("piezo", "mechanical")


def reference_json(name: str) -> dict[str, Any]:
    """Return the file of a reconstructed stage."""
    return json.loads((REFERENCE / f"{name}-stage.json").read_text(encoding="utf-8"))


@dataclass(frozen=True)
class Reference:
    stage: Stage
    data: dict[str, Any]


def reference_stage(name: str) -> Reference:
    """Read a reconstructed stage; the files are in millimetres and degrees."""
    data = reference_json(name)

    def mm(values: list[float]) -> tuple[float, float]:
        return (values[0] * 1e-3, values[1] * 1e-3)

    bodies = tuple(
        Body(
            name=key,
            outline=Loop(tuple(mm(p) for p in entry["loops"][0])),
            holes=tuple(Loop(tuple(mm(p) for p in loop)) for loop in entry["loops"][1:]),
            mounting_holes=tuple(
                Circle(mm(hole[:2]), hole[2] * 1e-3) for hole in entry["circular_holes"]
            ),
            fixed=key == data["fixed"],
        )
        for key, entry in data["bodies"].items()
    )
    hinges = tuple(
        Hinge(
            name=entry["tag"] + f"-{k}",
            bodies=(entry["a"], entry["b"]),
            at=mm(entry["c"]),
            direction=math.radians(entry["angle_deg"]),
            profile=RightCircular(
                neck_thickness=entry["neck"] * 1e-3, radius=entry["radius"] * 1e-3
            ),
        )
        for k, entry in enumerate(data["hinges"])
    )
    drives = tuple(
        Screw(
            name=port["name"],
            pushes=port["pushes"],
            reacts=port["reacts"],
            at=(mm(port["at"][0]), mm(port["at"][1])),
            direction=math.atan2(port["direction"][1], port["direction"][0]),
            patch_half_width=port["half_width"] * 1e-3,
            pitch=0.5e-3,
            smallest_step=0.5e-6,
            travel=0.35e-3,
        )
        for port in data["ports"]
    )
    probes = tuple(
        Probe(
            name=f"probe-{k}", body="PY", at=bodies[-2].outline.points[0], direction=k * math.pi / 2
        )
        for k in range(2)
    )
    stage = Stage(
        name=name,
        thickness=data["thickness"] * 1e-3,
        material=material(data["material"]["name"]),
        bodies=bodies,
        hinges=hinges,
        drives=drives,
        probes=probes,
    )
    return Reference(stage, data)
