"""The same job by other routes: SymPy's mechanics package, naive Hessians, EXUDYN."""

import numpy as np
import scipy.linalg
import sympy as sp

from flexstage.lumped import Mechanism, symbolic_model

__all__ = ["exudyn_figures", "mechanics_figures", "naive_hessians", "numeric_figures"]


def mechanics_figures(mechanism: Mechanism) -> np.ndarray:
    """Bodies as points and frames, `LagrangesMethod` with numbers, linearised; statics, modes."""
    from sympy.physics import mechanics as me

    frame = me.ReferenceFrame("N")
    origin = me.Point("O")
    origin.set_vel(frame, 0)
    q: list[sp.Expr] = []
    places, bodies, V = {}, [], sp.S.Zero
    for i, body in enumerate(mechanism.bodies):
        if body.fixed:
            places[i] = (0, 0, 0)
            continue
        x, y, theta = me.dynamicsymbols(f"x{i} y{i} theta{i}")
        q += [x, y, theta]
        places[i] = (x, y, theta)
        turned = frame.orientnew(f"B{i}", "Axis", (theta, frame.z))
        centre = origin.locatenew(
            f"C{i}", (body.centre[0] + x) * frame.x + (body.centre[1] + y) * frame.y
        )
        centre.set_vel(frame, centre.pos_from(origin).dt(frame))
        inertia = me.inertia(turned, 0, 0, body.inertia)
        bodies.append(me.RigidBody(f"R{i}", centre, turned, body.mass, (inertia, centre)))
    for hinge in mechanism.hinges:
        ends = []
        for b in hinge.bodies:
            x, y, theta = places[b]
            X, Y = np.subtract(hinge.at, mechanism.bodies[b].centre)
            ends.append((x - theta * Y, y + theta * X, theta))
        dx, dy, dt = (b - a for a, b in zip(*ends, strict=True))
        c, s = round(np.cos(hinge.direction), 12), round(np.sin(hinge.direction), 12)
        deformation = sp.Matrix([c * dx + s * dy, c * dy - s * dx, dt])
        V += (deformation.T * sp.Matrix(hinge.stiffness) * deformation)[0] / 2
    L = sum((body.kinetic_energy(frame) for body in bodies), start=sp.S.Zero) - V
    method = me.LagrangesMethod(L, q, bodies=bodies, frame=frame)
    method.form_lagranges_equations()
    M = np.array(method.mass_matrix.tolist(), dtype=float)
    K = -np.array(method.forcing.jacobian(q).tolist(), dtype=float)
    return _solve(M, K)


def naive_hessians(mechanism: Mechanism) -> sp.Matrix:
    """Sum the energies of all hinges, then differentiate the sum twice by every coordinate."""
    model = symbolic_model(mechanism, damping="none")
    K = sp.hessian(model.potential_energy, list(model.coordinates))
    M = sp.hessian(model.kinetic_energy, list(model.rates))
    return K + M


def exudyn_figures(mechanism: Mechanism, drives: list[str]) -> np.ndarray:
    """Build the mechanism, solve the statics of every drive, then the modes."""
    from benchmarks.exudyn_model import ExudynModel

    for drive in drives:
        ExudynModel(mechanism, {drive: 100.0}).static(tolerance=1e-8)
    return ExudynModel(mechanism).frequencies()[:6]


def numeric_figures(mechanism: Mechanism) -> np.ndarray:
    """Our own numeric route, for mechanisms without a stage: matrices, statics, modes."""
    from flexstage.lumped import nonlinear

    model = nonlinear(mechanism)
    return _solve(np.diag(model.mass), model.tangent(np.zeros(model.order)))


def _solve(M: np.ndarray, K: np.ndarray) -> np.ndarray:
    scipy.linalg.solve(K, np.eye(K.shape[0])[:, :2], assume_a="pos")
    return np.sqrt(scipy.linalg.eigh(K, M, eigvals_only=True)[:6]) / (2.0 * np.pi)
