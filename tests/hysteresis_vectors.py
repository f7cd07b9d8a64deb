"""The test vectors in the folders of the hysteresis models: what each law gave, step by step.

    python -m tests.hysteresis_vectors KIND...

works outputs and states out again, from the parameters and inputs that stand in the file.
"""

import json
import sys
from dataclasses import dataclass
from importlib import resources
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Any

import numpy as np

from flexstage.hysteresis import MODELS, HysteresisModel
from flexstage.hysteresis.model import Array

__all__ = ["VECTORS", "Vector", "of_kind"]


@dataclass(frozen=True)
class Vector:
    """A model, inputs one after the other from rest, and what it answered to each."""

    model: HysteresisModel
    inputs: Array
    outputs: Array
    states: Array


def of_kind(kind: str) -> list[Vector]:
    """Return the vectors of a model."""
    return [
        Vector(
            _model(kind, case["parameters"]),
            *(np.array(case[name]) for name in ("inputs", "outputs", "states")),
        )
        for case in json.loads(_file(kind).read_text("ascii"))
    ]


def _file(kind: str) -> Traversable:
    folder = resources.files("flexstage.hysteresis.models") / kind.replace("-", "_")
    return folder / "vectors.json"


def _model(kind: str, parameters: dict[str, Any]) -> HysteresisModel:
    # arrays as tuples: a model makes of them what it wants
    return MODELS[kind](
        **{k: tuple(v) if isinstance(v, list) else v for k, v in parameters.items()}
    )


#: Every vector, by the name of the model and its place in the file.
VECTORS = {f"{kind}, {i}": v for kind in MODELS for i, v in enumerate(of_kind(kind), start=1)}


def _write(kind: str) -> None:
    made = []
    for case in json.loads(_file(kind).read_text("ascii")):
        model = _model(kind, case["parameters"])
        state, outputs, states = model.initial_state(), [], []
        for u in case["inputs"]:
            state, y = model.step(state, u)
            outputs.append(y)
            states.append(state.tolist())
        case |= {"outputs": outputs, "states": states}
        parts = [f'  "{name}": {json.dumps(value)}' for name, value in case.items()]
        made.append("{\n" + ",\n".join(parts) + "\n}")
    Path(str(_file(kind))).write_text("[" + ", ".join(made) + "]\n", encoding="ascii")


if __name__ == "__main__":
    for name in sys.argv[1:]:
        _write(name)
