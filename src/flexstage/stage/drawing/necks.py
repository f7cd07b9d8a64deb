"""Which thin places of a part are necks, and how sure that is."""

from flexstage.errors import StageError
from flexstage.stage.drawing.contours import DrawnPart
from flexstage.stage.drawing.profiles import Neck, neck_of, parted
from flexstage.stage.drawing.thickness import Pass, Relief, relief

#: A neck is at least so much thinner than the thinner of its two bodies, unless a limit is given.
LEAST_RATIO = 1.5
#: Above the gap in thickness a neck counts where its profile is a notch and its bodies this much
#: thicker.
CLEAR_RATIO = 2.0


def find_necks(
    part: DrawnPart, limit: float | None = None
) -> tuple[list[Neck], tuple[float, float] | None]:
    """Return the necks of a part, and the gap in thickness above them.

    That is the thickness of the thickest neck, and of the thinnest place that is none [m]; None
    where all thin places are necks.

    All places thinner than `limit` are necks [m]; where none is given, those below the widest gap
    in the thicknesses of all thin places, and above it those whose sides are a notch by its own
    lines and arcs.
    """
    found = relief(part)
    chosen = _chosen(part, found, limit)
    necks = []
    for each in chosen:
        neck = neck_of(part, each)
        if neck is None:
            x, y = each.sides[0].at
            raise StageError(
                f"the neck about {part.place((x, y))}, {each.thickness * 1e3:.4g} mm thick, has no "
                "profile that a hinge can have: both halves must be alike, and both sides, or one "
                "straight; mend the drawing there, or give --contours neck_limit=LENGTH below its "
                "thickness to leave it out"
            )
        necks.append(neck)
    if not necks:
        raise StageError(
            "the drawing holds no neck: no place of the part is so much thinner than what lies on "
            "both sides of it; give --contours neck_limit=LENGTH, the thickest neck that counts"
        )
    thickest = max(n.profile.neck_thickness for n in necks)
    others = [p.thickness for p in found.passes if p not in chosen and p.thickness > thickest]
    return parted(necks), (thickest, min(others)) if others else None


def _chosen(part: DrawnPart, found: Relief, limit: float | None) -> list[Pass]:
    """Choose the passes that are necks."""
    by_size = sorted(found.passes, key=lambda p: p.thickness)
    if limit is not None:
        return _separating([p for p in by_size if p.thickness <= 1.05 * limit], found)
    clear = [p for p in by_size if p.ratio >= LEAST_RATIO]
    if not clear:
        return []
    # the widest gap, on a scale of ratios; beyond the last one lies the thinnest body
    sizes = [p.thickness for p in clear]
    beyond = max(sizes[-1], min(found.heights[h] for p in clear for h in p.hills))
    steps = [b / a for a, b in zip(sizes, [*sizes[1:], beyond], strict=True)]
    cut = sizes[max(range(len(steps)), key=lambda k: steps[k])]
    below = [p for p in clear if p.thickness <= cut]
    above = [p for p in clear if p.thickness > cut and p.ratio >= CLEAR_RATIO]
    return _separating([*below, *(p for p in above if _is_notch(part, p))], found)


def _is_notch(part: DrawnPart, found: Pass) -> bool:
    neck = neck_of(part, found)
    if neck is None or neck.profile.kind in ("as-drawn", "leaf"):
        return False
    # a wall beside a pocket with round corners has two fillets and a straight side as well
    return not (neck.profile.one_sided and neck.profile.flat_length > 0.0)


def _separating(chosen: list[Pass], found: Relief) -> list[Pass]:
    """Leave out the passes within one body, once the others are no border."""
    hill = {k: k for k in found.heights}

    def root(k: int) -> int:
        while hill[k] != k:
            k = hill[k]
        return k

    for other in found.passes:
        if other not in chosen:
            a, b = (root(h) for h in other.hills)
            hill[a] = b
    return [p for p in chosen if root(p.hills[0]) != root(p.hills[1])]


def certainty(neck: Neck, gap: tuple[float, float] | None) -> str:
    """Say in a word how sure a neck is: ``sure``, ``likely`` or ``doubtful``."""
    wide = gap is None or gap[1] >= 2.0 * gap[0] or neck.profile.neck_thickness < 0.5 * gap[1]
    drawn = neck.profile.kind == "as-drawn"
    if neck.found.ratio >= CLEAR_RATIO and wide and not drawn:
        return "sure"
    return "likely" if neck.found.ratio >= LEAST_RATIO and (wide or not drawn) else "doubtful"
