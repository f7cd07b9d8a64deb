"""A platform on three legs of three notches each (3-RRR), small and with awkward numbers."""

import math
from collections.abc import Sequence

from flexstage.hinges import RightCircular
from flexstage.quantities.material import material
from flexstage.stage import Axis, Body, Circle, Hinge, Loop, PiezoStack, Probe, Stage

#: Distance of the crank's line and of the platform's edge from the middle, length of the crank, and
#: where the drive pushes it from its first notch [m].
FAR, EDGE, CRANK, ARM = 31e-3, 13e-3, 8.5e-3, 3.9e-3
HALF = 1.6e-3
NOTCH = RightCircular(radius=1.3e-3, neck_thickness=0.43e-3)
#: Directions of the legs from the middle [rad].
AWRY = (math.radians(7.0), math.radians(131.0), math.radians(246.0))
EVEN = tuple(math.radians(a) for a in (13.0, 133.0, 253.0))


def three_legs(
    angles: Sequence[float] = AWRY,
    *,
    drives: Sequence[str] = ("a", "b", "c"),
    centre: tuple[float, float] = (0.0, 0.0),
) -> Stage:
    """A platform with a hole, a fixed disc in the hole, and three legs, each with its drive.

    In the frame of a leg, whose x axis is its direction: the crank turns about (FAR, 0), its end
    (FAR, CRANK) pulls the platform's edge at (EDGE, CRANK) by a link along x, and the drive pushes
    the crank at (FAR + HALF, ARM) along -x.
    """
    r = NOTCH.radius
    bodies, hinges, stacks = [], [], []
    for k, angle in enumerate(angles):
        c, s = math.cos(angle), math.sin(angle)

        def at(x: float, y: float, c: float = c, s: float = s) -> tuple[float, float]:
            return centre[0] + c * x - s * y, centre[1] + s * x + c * y

        def box(x0: float, x1: float, y0: float, y1: float, at=at) -> Loop:
            return Loop((at(x0, y0), at(x1, y0), at(x1, y1), at(x0, y1)))

        far, base, crank, link = FAR + HALF + 5e-3, f"base {k}", f"crank {k}", f"link {k}"
        corners = ((FAR - HALF, -r), (FAR - HALF, -7e-3), (far + 5e-3, -7e-3), (far + 5e-3, 7e-3))
        corners += ((far, 7e-3), (far, -r))
        bolt = Circle(at(far - 0.5e-3, -4.2e-3), 1.1e-3)
        outline = Loop(tuple(at(*p) for p in corners))
        bodies += [
            Body(name=base, outline=outline, mounting_holes=(bolt,), fixed=True),
            Body(name=crank, outline=box(FAR - HALF, FAR + HALF, r, CRANK + HALF)),
            Body(
                name=link,
                outline=box(EDGE + 2 * r, FAR - HALF - 2 * r, CRANK - HALF, CRANK + HALF),
            ),
        ]
        hinges += [
            Hinge(name=f"{name} {k}", bodies=pair, at=at(*where), direction=turn, profile=NOTCH)
            for name, pair, where, turn in (
                ("root", (base, crank), (FAR, 0.0), angle + math.pi / 2),
                ("elbow", (crank, link), (FAR - HALF - r, CRANK), angle + math.pi),
                ("head", (link, "platform"), (EDGE + r, CRANK), angle + math.pi),
            )
        ]
        stacks.append(
            PiezoStack(
                name=("a", "b", "c")[k],
                pushes=crank,
                reacts=base,
                at=(at(FAR + HALF, ARM), at(far, ARM)),
                direction=angle + math.pi,
                patch_half_width=1.1e-3,
                free_stroke=(9e-6, 11e-6, 7.5e-6)[k],
                stiffness=2.1e7,
                voltage_range=(0.0, 120.0),
            )
        )
    bodies.append(
        Body(name="platform", outline=_platform(angles, centre), holes=(Circle(centre, 6e-3),))
    )
    bodies.append(Body(name="post", outline=Circle(centre, 4.7e-3).loop(), fixed=True))

    def beside(x: float, y: float) -> tuple[float, float]:
        return centre[0] + x, centre[1] + y

    return Stage(
        name="three legs",
        thickness=5e-3,
        material=material("Al 7075-T6"),
        bodies=tuple(bodies),
        hinges=tuple(hinges),
        drives=tuple(stacks),
        probes=(
            Probe(name="x", body="platform", at=beside(8.3e-3, 2.1e-3), direction=0.0),
            Probe(name="y", body="platform", at=beside(-2.4e-3, 8.6e-3), direction=math.pi / 2),
            Probe(name="turn", body="platform", at=beside(-7.1e-3, -4.9e-3), reads="rotation"),
        ),
        axes=tuple(
            Axis(name=n, drives=tuple(drives), probe=p)
            for n, p in (("x", "x"), ("y", "y"), ("theta", "turn"))
        ),
    )


def _platform(angles: Sequence[float], centre: tuple[float, float]) -> Loop:
    """The triangle of the three edges with its corners cut off, a little beyond the links."""
    points = []
    for a in angles:
        c, s = math.cos(a), math.sin(a)
        for y in (-(CRANK + HALF + 1.1e-3), CRANK + HALF + 1.1e-3):
            points.append((centre[0] + c * EDGE - s * y, centre[1] + s * EDGE + c * y))
    return Loop(tuple(points))
