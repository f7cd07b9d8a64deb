"""Outlines of contours that are neither lines nor arcs."""

from collections.abc import Sequence

import numpy as np

from flexstage.hinges.profile import Piece, Vertex


def chords(pieces: Sequence[Piece], number: int = 64) -> tuple[Vertex, ...]:
    """Return the vertices of a polyline inscribed in a contour.

    Each of the `number` chords of a piece ends on the contour; of a quarter ellipse they cut off
    0.4/number^2 of its area.

    Examples
    --------
    >>> from flexstage.hinges import RightCircular
    >>> notch = RightCircular(neck_thickness=0.5e-3, radius=1e-3)
    >>> len(chords(notch.pieces(), 8))
    9
    """
    vertices = [Vertex(0.0, 0.0)]
    for piece in pieces:
        x, depth, _, _ = piece(np.arange(1, number + 1) / number)
        vertices.extend(Vertex(float(a), float(b)) for a, b in zip(x, depth, strict=True))
    return tuple(vertices)
