"""Finding free places for short labels in a crowded drawing."""

import numpy as np
from numpy.typing import NDArray

# Every place that is tried: 16 directions, at first beside the point, then heights further away.
_STEPS = np.repeat((0.0, 0.6, 1.2, 2.0, 3.0, 4.5), 16)
_ALONG = np.tile(np.cos(np.pi / 8.0 * np.arange(16)), 6)
_UP = np.tile(np.sin(np.pi / 8.0 * np.arange(16)), 6)


class Placer:
    """Keeps track of what is taken, and gives each new label the best free place.

    Labels stay within the bounds: smallest x and y, largest x and y.
    """

    def __init__(self, bounds: tuple[float, float, float, float]) -> None:
        self._bounds = bounds
        self._taken: list[tuple[float, float, float, float]] = []

    def take(self, x: float, y: float, width: float, height: float) -> None:
        """Mark a rectangle about a centre as taken."""
        self._taken.append((x - width / 2, y - height / 2, x + width / 2, y + height / 2))

    def is_free(self, x: float, y: float, width: float, height: float) -> bool:
        """Say whether a rectangle about a centre touches nothing that is taken."""
        return bool(self._overlap(np.array([[x, y]]), width, height)[0] == 0.0)

    def place(
        self, x: float, y: float, width: float, height: float, *, nearest: float
    ) -> tuple[float, float]:
        """Find a place for a label near a point, and take it; returns its centre.

        `nearest` is the smallest distance between the point and the edge of the label.
        """
        # the label's own half size in each direction, then the gap
        with np.errstate(divide="ignore"):
            reach = np.minimum(0.5 * width / abs(_ALONG), 0.5 * height / abs(_UP))
        distance = reach + nearest + _STEPS * height
        at = np.column_stack((x + _ALONG * distance, y + _UP * distance))
        # a twentieth of a label covered is as bad as a label three heights further away
        cost = 10.0 * self._overlap(at, width, height) + 0.15 * width * height * _STEPS
        best_x, best_y = map(float, at[np.argmin(cost)])
        self.take(best_x, best_y, width, height)
        return best_x, best_y

    def _overlap(self, at: NDArray[np.float64], width: float, height: float) -> NDArray[np.float64]:
        """Area that a label at each of some places covers of what is taken, or lies outside."""
        left, bottom = at[:, 0] - width / 2, at[:, 1] - height / 2
        right, top = left + width, bottom + height
        x0, y0, x1, y1 = np.reshape(self._taken, (-1, 4)).T[:, :, None]
        across = np.minimum(right, x1) - np.maximum(left, x0)
        up = np.minimum(top, y1) - np.maximum(bottom, y0)
        covered = np.sum(np.maximum(across, 0.0) * np.maximum(up, 0.0), axis=0)
        x0, y0, x1, y1 = self._bounds
        outside = np.maximum(x0 - left, 0.0) + np.maximum(right - x1, 0.0)
        outside += np.maximum(y0 - bottom, 0.0) + np.maximum(top - y1, 0.0)
        return covered + 10.0 * outside * height
