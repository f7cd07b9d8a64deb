"""Motions of necks as rows over the unknowns of a part: means that do work with tractions."""

import math
from collections.abc import Sequence
from functools import lru_cache

import ngsolve as ng
import numpy as np
from numpy.polynomial import Legendre, Polynomial

from flexstage.arrays import Array
from flexstage.elasticity.shapes import METRE
from flexstage.fem.geometry import exactly, neck_edge
from flexstage.fem.substructure import CutNeck

# Tractions without resultant go up to this degree; a neck is often one element wide.
_HIGHEST = 6


def edge_means(
    mesh: ng.Mesh, order: int, necks: Sequence[CutNeck], highest: int | None = None
) -> list[Array]:
    """Return the means over necks of the powers of eta, -1 to 1 across, times a displacement.

    For each neck for each unknown of one component, up to the highest power p, the order of the
    space where none is given, shape (p + 1, n); the necks are named by their number.
    """
    highest = order if highest is None else highest
    scalar = ng.H1(mesh, order=order)
    names = [exactly(neck_edge(str(i))) for i in range(len(necks))]
    eta = {}
    for name, neck in zip(names, necks, strict=True):
        c, s = math.cos(neck.direction), math.sin(neck.direction)
        across = (ng.y / METRE - neck.at[1]) * c - (ng.x / METRE - neck.at[0]) * s
        eta[name] = across * (2.0 / neck.profile.neck_thickness)
    coordinate = mesh.BoundaryCF(eta, default=0.0)
    powers = [ng.CoefficientFunction(1.0)]
    while len(powers) <= highest:
        powers.append(powers[-1] * coordinate)
    v = scalar.TestFunction()
    rows = []
    for power in powers:
        form = ng.LinearForm(scalar)
        form += power * v * ng.ds("|".join(names), bonus_intorder=highest)
        form.Assemble()
        rows.append(form.vec.FV().NumPy().copy())
    of_all = np.array(rows)
    means = []
    for name, neck in zip(names, necks, strict=True):
        own = np.array(scalar.GetDofs(mesh.Boundaries(name)), dtype=bool)
        means.append(np.where(own, of_all, 0.0) / (METRE * neck.profile.neck_thickness))
    return means


@lru_cache(maxsize=16)
def neck_weights(degree: int) -> tuple[Array, Array, Array]:
    """Weights over a neck, by the powers of eta up to a degree: of a beam, normal and shear.

    Those of a beam are for displacement along and across and for rotation times half the neck.
    Those without resultant are the Legendre polynomials from the second on for the normal
    displacement and, for the other one, the shear tractions (1 - eta^2) P'_k, which vanish at the
    surfaces as the parabola does.
    """
    highest = min(degree, _HIGHEST)
    bubble = Polynomial([1.0, 0.0, -1.0])
    legendre = [Legendre.basis(k).convert(kind=Polynomial) for k in range(highest + 1)]
    parabola = 1.5 * bubble if degree > 1 else Polynomial([1.0])
    beam = [Polynomial([1.0]), parabola, Polynomial([0.0, -3.0])]
    normal, shear = legendre[2:], [bubble * p.deriv() for p in legendre[2:-1]]

    def table(weights: Sequence[Polynomial]) -> Array:
        rows = np.zeros((len(weights), degree + 1))
        for row, weight in zip(rows, weights, strict=True):
            row[: len(weight.coef)] = weight.coef
        return rows

    return table(beam), table(normal), table(shear)


def neck_rows(neck: CutNeck, means: Array) -> tuple[Array, Array, Array]:
    """Return means of the displacement over a neck.

    Of `edge_means`: those that do work with the tractions of a beam, along, across and the
    rotation, shape (3, n); those with normal and with shear tractions that have no resultant,
    shapes (k, n).
    """
    c, s = math.cos(neck.direction), math.sin(neck.direction)
    tables = neck_weights(means.shape[0] - 1)
    turns = 2.0 / neck.profile.neck_thickness

    def along(rows: Array) -> Array:
        return np.concatenate((c * rows, s * rows), axis=1)

    def across(rows: Array) -> Array:
        return np.concatenate((-s * rows, c * rows), axis=1)

    beam, normal, shear = (np.asarray(table @ means) for table in tables)
    first = (along(beam[:1]), across(beam[1:2]), turns * along(beam[2:]))
    return np.concatenate(first), along(normal), across(shear)


def shaped(P: Array, X: Array, blocks: Sequence[tuple[int, int]]) -> tuple[Array, Array]:
    r"""Shape the tractions in the necks as those of a notch that is the same on both sides.

    About such a notch a normal force and a moment leave the neck plane and its shear traction
    nothing, and a shear force moves all of the neck alike across and leaves its normal traction
    nothing. The tractions without resultant that make it so are a part of each:
    :math:`\lambda_e = -F_{ee}^{-1} F_{er} \lambda_r` with the flexibility F of the neck.

    P are the rows of `neck_rows` for each neck in turn, and after them any others, shape (m, n), X
    the responses to them as loads, shape (n, m), and `blocks` for each neck the numbers of its
    normal and shear rows without resultant. Returns rows, three for each neck and then the others,
    shape (k, n), and responses, shape (n, k).
    """
    if not blocks:
        return P, X
    flexibility = P @ X
    count = len(P)
    kept, at = [np.zeros((0, count))], 0
    for normal, shear in blocks:
        end = at + 3 + normal
        rows = np.eye(count)[at : at + 3]
        for motions, extra in (((0, 2), slice(at + 3, end)), ((1,), slice(end, end + shear))):
            for k in motions:
                response = flexibility[extra, at + k]
                rows[k, extra] = -np.linalg.lstsq(flexibility[extra, extra], response, rcond=1e-10)[
                    0
                ]
        kept.append(rows)
        at = end + shear
    kept.append(np.eye(count)[at:])
    mix = np.concatenate(kept)
    return mix @ P, X @ mix.T
