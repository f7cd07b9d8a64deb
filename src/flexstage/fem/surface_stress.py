"""Stress on the surfaces of notches, of displacements of a part in a plane or of a plate."""

import ngsolve as ng
import numpy as np

from flexstage.arrays import Array
from flexstage.elasticity import Continuum
from flexstage.elasticity.loaded import COMPONENTS
from flexstage.elasticity.shapes import METRE
from flexstage.fem.layered_plate import LayeredPlate
from flexstage.fem.necks import NeckPoints

#: Places through half of the thickness where the stress is looked for, in parts of it.
LEVELS = (0.0, 0.25, 0.5, 0.75, 1.0)


def layered_stress(plate: LayeredPlate, points: NeckPoints, basis: Array) -> Array:
    """Return the stress of displacements at the points of the notches, level by level.

    Components xx, yy, zz, yz, xz, xy [Pa], shape (l, m, 6, r).
    """
    r = basis.shape[1]
    through = plate.through
    parts = through.components
    fields = plate.expanded(basis)
    values, slopes = slopes_at(points, plate.plane.mesh, plate.plane.order, fields)
    z = np.array(LEVELS) * through.thickness / 2.0
    functions = through.values_at(z)
    gradient = np.zeros((z.size, len(values), 3, 3, r))  # of displacement i along j
    for i, (d, kind, k) in enumerate(parts):
        value, slope = (f[k][:, None, None] for f in functions[kind])
        gradient[:, :, d, 0] += value * slopes[None, :, i, :, 0]
        gradient[:, :, d, 1] += value * slopes[None, :, i, :, 1]
        gradient[:, :, d, 2] += slope * values[None, :, i]
    gradient = gradient.reshape(-1, 3, 3, r)
    modulus, poisson = plate.material.youngs_modulus, plate.material.poissons_ratio
    shear = modulus / (2.0 * (1.0 + poisson))
    lame = modulus * poisson / ((1.0 + poisson) * (1.0 - 2.0 * poisson))
    volume = lame * np.einsum("miir->mr", gradient)
    found = np.stack(
        [
            (volume if i == j else 0.0) + shear * (gradient[:, i, j] + gradient[:, j, i])
            for i, j in COMPONENTS
        ],
        axis=1,
    )
    return found.reshape(z.size, -1, 6, r)


def surface_stress(continuum: Continuum, points: NeckPoints, u: Array) -> Array:
    """Return the stress of many displacements of a plane part at the points of its notches.

    Components xx, yy, zz, xy [Pa], shape (m, 4, r), of displacements u, shape (n, r).
    """
    r = u.shape[1]
    if not len(points.places):
        return np.zeros((0, 4, r))
    gradient = slopes_at(points, continuum.mesh, continuum.order, u.reshape(2, -1, r))[1]
    gradient = gradient.transpose(0, 2, 1, 3)
    constants = ng.CoefficientFunction((continuum.lame, continuum.in_strain))
    lame, strained = np.asarray(ng.BoundaryFromVolumeCF(constants)(points.places)).T[..., None]
    xx, yy = gradient[..., 0, 0], gradient[..., 1, 1]
    volume = lame * (xx + yy)
    twice = 2.0 * continuum.shear_modulus
    shear = continuum.shear_modulus * (gradient[..., 0, 1] + gradient[..., 1, 0])
    parts = (volume + twice * xx, volume + twice * yy, strained * volume, shear)
    return np.stack(parts, axis=1)


def slopes_at(points: NeckPoints, mesh: ng.Mesh, order: int, u: Array) -> tuple[Array, Array]:
    """Return fields in a plane and their derivatives [1/m] at the points of notches.

    Of c components of r displacements, shape (c, n, r): shapes (m, c, r) and (m, c, r, 2).
    """
    c, _, r = u.shape
    # all fields as the components of one function: they are evaluated at once
    function = ng.GridFunction(ng.H1(mesh, order=order, dim=c * r))
    function.vec.FV().NumPy()[:] = u.transpose(1, 0, 2).reshape(-1)
    found = []
    for field in (function, ng.Grad(function)):
        found.append(np.asarray(ng.BoundaryFromVolumeCF(field)(points.places)))
    return found[0].reshape(-1, c, r), METRE * found[1].reshape(-1, c, r, 2)
