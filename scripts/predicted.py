#!/usr/bin/env python3
"""Write the ranges of the figures that the study's stages are predicted to have.

python scripts/predicted.py

It takes some three minutes of one core. Ranges are those of `flexstage reconstruct STAGE --members
0`. That of the resonance on ideal seats is by the same covariance, with the value of the
superelement model and derivatives of its logarithm by rigid bodies.
"""

import json
from typing import Any

import numpy as np

from flexstage.base.arrays import Array
from flexstage.base.errors import FlexstageError
from flexstage.measure.posterior import Posterior
from flexstage.stage import PiezoStack, Stage
from flexstage.stage.designs import StageTemplate
from flexstage.stage.designs.vgtu import IDEAL_SEATS, MOTION_ERROR_CLAIMS, RANGES_PATH
from flexstage.studies.explore import Ensemble
from flexstage.studies.explore.prepare import ready_reconstruct
from flexstage.studies.explore.requests import ReconstructRequest
from flexstage.studies.explore.workers import Workers
from flexstage.studies.models import analyse_model
from flexstage.system.implied_seat import implied_seat

#: Half of a 95 % range, and step of derivatives, in standard deviations.
_NORMAL, _STEP = 1.96, 0.01


def summary(ensemble: Ensemble) -> dict[str, Any]:
    """Return the ranges of an ensemble with their origin."""
    rows = {
        row.figure.name: {
            "quantity": row.figure.quantity,
            "axis": row.figure.axis,
            **{name: _rounded(getattr(row, name)) for name in ("described", "low", "high")},
        }
        for row in ensemble.figure_rows()
        if not row.zero
    }
    return {
        "command": f"flexstage reconstruct {ensemble.template.source} --members 0",
        "model": ensemble.model,
        "given": [o.figure.name for o in ensemble.observations],
        "dimensions": len(ensemble.dimensions),
        "informed": round(ensemble.informed, 2),
        "version": ensemble.provenance.version,
        "input_hash": ensemble.provenance.input_hash,
        "created": ensemble.provenance.created,
        "figures": rows | _on_ideal_seats(ensemble),
    }


def _rounded(value: float) -> float:
    return float(f"{value:.4g}")


def _on_ideal_seats(ensemble: Ensemble) -> dict[str, Any]:
    stage = ensemble.template.stage()
    axes = [a.name for a in stage.axes if isinstance(stage.drive(a.drive or a.name), PiezoStack)]
    if not axes:
        return {}
    values = _ideal(ensemble.template.stage(), axes, ensemble.model)
    # about the described stage, which is the most probable one within a percent
    spread = Posterior(covariance=ensemble.posterior.covariance).spread(_slopes(ensemble, axes))
    rows = {}
    for axis, value, s in zip(axes, values.tolist(), spread.tolist(), strict=True):
        low, high = (value * np.exp(sign * _NORMAL * s) for sign in (-1.0, 1.0))
        rows[f"{IDEAL_SEATS}.{axis}"] = {
            "quantity": IDEAL_SEATS,
            "axis": axis,
            **{"described": _rounded(value), "low": _rounded(low), "high": _rounded(high)},
        }
    return rows


def _slopes(ensemble: Ensemble, axes: list[str]) -> Array:
    """Return derivatives of logarithms of the resonances by the coordinates, shape (a, p)."""
    usual, slopes = ensemble.family.usual, []
    here = np.log(_ideal(ensemble.family.stage(usual), axes, "lumped"))
    for j, dimension in enumerate(ensemble.dimensions):
        for sign in (1.0, -1.0):
            point = usual.copy()
            point[j] *= np.exp(sign * _STEP * dimension.sigma)
            try:
                moved = np.log(_ideal(ensemble.family.stage(point), axes, "lumped"))
            except FlexstageError:
                continue
            slopes.append((moved - here) / (sign * _STEP))
            break
        else:
            slopes.append(np.zeros(len(axes)))
    return np.array(slopes).T


def _ideal(stage: Stage, axes: list[str], model: str) -> Array:
    system = analyse_model(stage, model).system
    published = {
        r.axis: r.estimate
        for r in StageTemplate.of("vgtu-piezo").stage().published
        if (r.quantity, r.origin) == ("natural_frequency_hz", "published-measured")
    }
    return np.array([implied_seat(stage, system, a, published[a]).ideal_hz for a in axes])


def ensembles() -> dict[str, Ensemble]:
    """Return what the published finite elements tell of each stage of the study."""
    request = ReconstructRequest(members=0)
    return {
        name: ready_reconstruct(request, StageTemplate.of(name))(Workers(1))
        for name in MOTION_ERROR_CLAIMS
    }


if __name__ == "__main__":
    found = {name: summary(ensemble) for name, ensemble in ensembles().items()}
    RANGES_PATH.write_text(json.dumps(found, indent=1) + "\n")
