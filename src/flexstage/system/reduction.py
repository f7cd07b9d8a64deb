"""Smaller systems that keep the static or the lowest dynamic behaviour of a larger one."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from flexstage.arrays import Array
from flexstage.errors import ModelError
from flexstage.system.linalg import solve_stiffness
from flexstage.system.mechanical import MechanicalSystem
from flexstage.system.modes import modes


def transformed(
    system: MechanicalSystem, basis: Array, coordinates: Sequence[str]
) -> MechanicalSystem:
    """Return a system in other coordinates, q = basis @ r.

    One new coordinate is a column of `basis`, shape (n, r); drives, probes, bodies and stress map
    stay.
    """
    if basis.shape != (system.order, len(coordinates)):
        raise ModelError(
            f"the basis must have shape {(system.order, len(coordinates))}, got {basis.shape}"
        )
    mass, stiffness = basis.T @ system.M @ basis, basis.T @ system.K @ basis
    stress = system.stress
    return replace(
        system,
        M=0.5 * (mass + mass.T),
        K=0.5 * (stiffness + stiffness.T),
        coordinates=tuple(coordinates),
        drives=tuple(replace(d, vector=basis.T @ d.vector) for d in system.drives),
        probes=tuple(replace(p, vector=basis.T @ p.vector) for p in system.probes),
        bodies=tuple(replace(b, matrix=b.matrix @ basis) for b in system.bodies),
        loads=tuple(replace(f, vector=basis.T @ f.vector) for f in system.loads),
        stress=None if stress is None else stress.in_basis(basis),
    )


def modal_reduction(system: MechanicalSystem, count: int) -> MechanicalSystem:
    """Keep the lowest modes of the bare stage.

    Parameters
    ----------
    system : MechanicalSystem
        The system.
    count : int
        Number of modes, drives removed.

    Returns
    -------
    MechanicalSystem
        A system with unit mass matrix. Its static response lacks what the left-out modes give.
    """
    kept = modes(system, drives="removed", count=count)
    names = [f"mode {i + 1} ({f:.4g} Hz)" for i, f in enumerate(kept.frequency_hz)]
    return transformed(system, kept.shapes, names)


def guyan_reduction(system: MechanicalSystem, keep: Sequence[str | int]) -> MechanicalSystem:
    """Condense a system to some of its coordinates (R. J. Guyan, AIAA J. 3 (1965) 380).

    Parameters
    ----------
    system : MechanicalSystem
        The system.
    keep : sequence of str or int
        Coordinates that stay, by name or index.

    Returns
    -------
    MechanicalSystem
        The condensed system: exact for static loads on the kept coordinates; its frequencies are
        upper bounds.

    Raises
    ------
    ModelError
        A coordinate does not exist or is named twice, or the rest is a mechanism.
    """
    index = []
    for k in keep:
        if isinstance(k, str):
            if k not in system.coordinates:
                raise ModelError(
                    f"there is no coordinate '{k}': the system has {', '.join(system.coordinates)}"
                )
            k = system.coordinates.index(k)  # noqa: PLW2901  # one name for both ways of saying it
        index.append(k)
    if len(set(index)) != len(index):
        raise ModelError("a coordinate to keep is named twice")
    rest = np.setdiff1d(np.arange(system.order), index)
    basis = np.zeros((system.order, len(index)))
    basis[index, np.arange(len(index))] = 1.0
    if rest.size:
        none = np.zeros((rest.size, 0))
        follow, _ = solve_stiffness(
            system.K[np.ix_(rest, rest)], -system.K[np.ix_(rest, index)], none
        )
        basis[rest] = follow
    return transformed(system, basis, [system.coordinates[i] for i in index])
