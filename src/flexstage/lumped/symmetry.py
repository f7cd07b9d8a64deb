"""Find the mirror of a symmetric mechanism."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexstage.arrays import Array
from flexstage.lumped.finite_rotation import nonlinear
from flexstage.lumped.rigid_bodies import Mechanism

# masses and places agree to this, relative to their size
_NEAR = 1e-9
_DIRECTIONS = (0.5 * np.pi, 0.0, 0.25 * np.pi, 0.75 * np.pi)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Mirror:
    """A line in which a mechanism is its own image."""

    point: tuple[float, float]
    """A point of the line [m]."""
    direction: float
    """Its direction, from the x axis to the left [rad]; a multiple of 45 degrees."""
    image: NDArray[np.int64]
    """Coordinates of the image, ``image @ q``: a permutation with signs, shape (n, n)."""
    asymmetry: float = 0.0
    """Largest difference between the stiffness and its image, relative to the diagonal [1]."""


def find_mirror(mechanism: Mechanism, *, tolerance: float = 1e-9) -> Mirror | None:
    """Find a line in which a mechanism is its own image.

    Lines through the mean of the necks, along x, y and between them, are tried; a line counts if M
    and K stay the same when each body moves like its image.

    `tolerance` is the largest difference of K and its image, relative to the diagonal [1]; masses
    and places must agree to 1e-9.
    """
    if not mechanism.hinges or not mechanism.free:
        return None
    necks = np.array([h.at for h in mechanism.hinges])
    middle = necks.mean(axis=0)
    size = float(np.abs(necks - middle).max()) or 1.0
    model = nonlinear(mechanism)
    stiffness = model.tangent(np.zeros(model.order))
    scale = np.sqrt(np.outer(np.diag(stiffness), np.diag(stiffness)))
    for direction in _DIRECTIONS:
        image = _image(mechanism, middle, direction, _NEAR * size)
        if image is None:
            continue
        turned = image.T @ stiffness @ image
        asymmetry = float(np.max(np.abs(turned - stiffness) / scale))
        if asymmetry <= tolerance:
            return Mirror(
                point=(float(middle[0]), float(middle[1])),
                direction=direction,
                image=image,
                asymmetry=asymmetry,
            )
    return None


def _image(
    mechanism: Mechanism, middle: Array, direction: float, near: float
) -> NDArray[np.int64] | None:
    """Pair every free body with its image; None where one has none."""
    c, s = round(np.cos(2.0 * direction)), round(np.sin(2.0 * direction))
    flip = np.array([[c, s], [s, -c]])
    bodies = [mechanism.bodies[i] for i in mechanism.free]
    image = np.zeros((3 * len(bodies), 3 * len(bodies)), dtype=np.int64)
    taken: set[int] = set()
    for i, body in enumerate(bodies):
        wanted = middle + flip @ (np.array(body.centre) - middle)
        for j, other in enumerate(bodies):
            if (
                j not in taken
                and np.abs(wanted - other.centre).max() <= near
                and abs(other.mass - body.mass) <= _NEAR * body.mass
                and abs(other.inertia - body.inertia) <= _NEAR * body.inertia
            ):
                taken.add(j)
                image[3 * j : 3 * j + 2, 3 * i : 3 * i + 2] = flip
                image[3 * j + 2, 3 * i + 2] = -1
                break
        else:
            return None
    return image
