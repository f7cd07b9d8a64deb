"""Finding free places for short labels in a crowded drawing."""

import itertools
import math

__all__ = ["Placer"]

_DIRECTIONS = [(math.cos(a), math.sin(a)) for a in (math.pi / 8.0 * k for k in range(16))]


class Placer:
    """Keeps track of what is taken, and gives each new label the best free place.

    Parameters
    ----------
    bounds : tuple of float
        Smallest x and y, largest x and y that a label may take.
    """

    def __init__(self, bounds: tuple[float, float, float, float]) -> None:
        self._bounds = bounds
        self._taken: list[tuple[float, float, float, float]] = []

    def take(self, x: float, y: float, width: float, height: float) -> None:
        """Mark a rectangle as taken.

        Parameters
        ----------
        x, y : float
            Its centre.
        width, height : float
            Its size.
        """
        self._taken.append((x - width / 2, y - height / 2, x + width / 2, y + height / 2))

    def is_free(self, x: float, y: float, width: float, height: float) -> bool:
        """Say whether a rectangle touches nothing that is taken.

        Parameters
        ----------
        x, y : float
            Its centre.
        width, height : float
            Its size.

        Returns
        -------
        bool
            Whether it is free.
        """
        return self._overlap((x, y), width, height) == 0.0

    def place(
        self, x: float, y: float, width: float, height: float, *, nearest: float
    ) -> tuple[float, float]:
        """Find a place for a label near a point, and take it.

        Parameters
        ----------
        x, y : float
            The point that is labelled.
        width, height : float
            Size of the label.
        nearest : float
            Smallest distance between the point and the edge of the label.

        Returns
        -------
        tuple of float
            Centre of the label.
        """
        best, best_cost = (x, y), math.inf
        for step, (c, s) in itertools.product((0.0, 0.6, 1.2, 2.0, 3.0, 4.5), _DIRECTIONS):
            # the label's own half size in that direction, then the gap
            reach = min(
                0.5 * width / abs(c) if abs(c) > 1e-9 else math.inf,
                0.5 * height / abs(s) if abs(s) > 1e-9 else math.inf,
            )
            distance = reach + nearest + step * height
            at = (x + c * distance, y + s * distance)
            # a twentieth of a label covered is as bad as a label three heights further away
            cost = 10.0 * self._overlap(at, width, height) + 0.15 * width * height * step
            if cost < best_cost:
                best, best_cost = at, cost
        self.take(*best, width, height)
        return best

    def _overlap(self, at: tuple[float, float], width: float, height: float) -> float:
        left, bottom = at[0] - width / 2, at[1] - height / 2
        right, top = left + width, bottom + height
        total = 0.0
        for x0, y0, x1, y1 in self._taken:
            across, up = min(right, x1) - max(left, x0), min(top, y1) - max(bottom, y0)
            if across > 0.0 and up > 0.0:
                total += across * up
        x0, y0, x1, y1 = self._bounds
        outside = max(x0 - left, 0.0) + max(right - x1, 0.0) + max(y0 - bottom, 0.0)
        outside += max(top - y1, 0.0)
        return total + 10.0 * outside * height
