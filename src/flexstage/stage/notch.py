"""The outline of the two halves of a notch, in the plane of the stage."""

from flexstage.stage.model import Hinge
from flexstage.stage.outline import Loop


def half_notch(hinge: Hinge, which: int) -> Loop:
    """Return the outline of the half of a notch that belongs to one of its bodies.

    It is bounded by the neck, the two sides of the notch, and the root on the body.

    `which` is 0 for the half of body a, 1 for that of body b. It is exact where the profile is made
    of lines and arcs.

    Examples
    --------
    >>> from flexstage.hinges import RightCircular
    >>> notch = RightCircular(neck_thickness=0.5e-3, radius=1e-3)
    >>> hinge = Hinge(name="h", bodies=("a", "b"), at=(0.0, 0.0), direction=0.0, profile=notch)
    >>> round(half_notch(hinge, 1).integrals().area * 1e6, 4)
    0.9292
    """
    profile = hinge.profile
    half_neck = 0.5 * profile.neck_thickness
    contour = profile.contour()
    side = (-1.0, 1.0)[which]
    # along the left side from the neck to the root, across, and back along the right side
    points = [(side * v.x, half_neck + v.depth) for v in contour]
    bulges = [side * v.bulge for v in contour[:-1]] + [0.0]
    if profile.one_sided:
        points += [(side * contour[-1].x, -half_neck), (0.0, -half_neck)]
        bulges += [0.0, 0.0]
    else:
        points += [(x, -y) for x, y in reversed(points)]
        # mirrored and run backwards, an arc turns to the same side
        bulges += [*reversed(bulges[:-1]), 0.0]
    return Loop(tuple(hinge.to_plane(*p) for p in points), tuple(bulges) if any(bulges) else ())
