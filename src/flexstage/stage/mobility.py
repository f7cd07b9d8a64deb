"""Motions that neither the hinges nor the drives of a stage constrain.

A hinge holds the two bodies together at its neck and lets them turn. With all drives locked as
well, no body should be free to move: a remaining motion is resisted by the bending of hinges alone.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexstage.stage.model import Stage

# singular values below this, relative to the largest, are motions without strain
_RANK = 1e-8
# a body that moves less than this, relative to the one that moves most, stands still
_STILL = 1e-6


@dataclass(frozen=True, slots=True, kw_only=True)
class FreeMotion:
    """Motions of a stage with locked drives."""

    freedoms: int
    """Number of independent motions."""
    turning: tuple[str, ...]
    """Bodies that mainly rotate."""
    shifting: tuple[str, ...]
    """Bodies that mainly translate."""

    @property
    def bodies(self) -> tuple[str, ...]:
        """All bodies that move."""
        return (*self.turning, *self.shifting)


def reachable_bodies(stage: Stage) -> set[str]:
    """Return the bodies that hinges connect to a fixed one."""
    neighbours: dict[str, set[str]] = {b.name: set() for b in stage.bodies}
    for hinge in stage.hinges:
        a, b = hinge.bodies
        neighbours[a].add(b)
        neighbours[b].add(a)
    found: set[str] = set()
    waiting = [b.name for b in stage.bodies if b.fixed]
    while waiting:
        name = waiting.pop()
        if name not in found:
            found.add(name)
            waiting += neighbours[name] - found
    return found


def free_motion(stage: Stage, *, hold_drives: bool = True) -> FreeMotion:
    """Find the motions that the hinges, taken as pins, leave free.

    Bodies that hinges do not connect to a fixed one are excluded; with `hold_drives` each drive
    keeps its length.

    Notes
    -----
    Small motions: the null space of the matrix that gives the motion at each neck of body b against
    body a, and the change in length of each drive.

    Validity: plane motion, small displacement.
    """
    held = reachable_bodies(stage)
    moving = [b for b in stage.bodies if not b.fixed and b.name in held]
    if not moving:
        return FreeMotion(freedoms=0, turning=(), shifting=())
    first = {b.name: 3 * k for k, b in enumerate(moving)}
    corners = np.concatenate([np.array(b.outline.points) for b in stage.bodies])
    scale = float(np.ptp(corners, axis=0).max())
    centres = {b.name: np.array(b.outline.points).mean(axis=0) for b in moving}

    def motion_at(body: str, point: tuple[float, float]) -> NDArray[np.float64]:
        """Displacement of a point of a body per coordinate; rotations are scaled to lengths."""
        out = np.zeros((2, 3 * len(moving)))
        if body in first:
            k = first[body]
            x, y = (np.array(point) - centres[body]) / scale
            out[:, k : k + 3] = [[1.0, 0.0, -y], [0.0, 1.0, x]]
        return out

    rows = [
        motion_at(h.bodies[1], h.at) - motion_at(h.bodies[0], h.at)
        for h in stage.hinges
        if h.bodies[0] in held
    ]
    if hold_drives:
        for d in stage.drives:
            along = np.array([[np.cos(d.direction), np.sin(d.direction)]])
            rows.append(along @ (motion_at(d.pushes, d.at[0]) - motion_at(d.reacts, d.at[0])))
    _, values, basis = np.linalg.svd(np.concatenate(rows), full_matrices=True)
    rank = int(np.sum(values > _RANK * values[0]))
    free = basis[rank:]
    turning, shifting = [], []
    largest = float(np.abs(free).max(initial=0.0))
    for body in moving:
        part = free[:, first[body.name] : first[body.name] + 3]
        shift = float(np.linalg.norm(part[:, :2]))
        size = float(np.ptp(np.array(body.outline.points), axis=0).max())
        turn = float(np.linalg.norm(part[:, 2])) * size / scale
        if max(shift, turn) > _STILL * largest:
            (turning if turn > shift else shifting).append(body.name)
    return FreeMotion(freedoms=len(free), turning=tuple(turning), shifting=tuple(shifting))
