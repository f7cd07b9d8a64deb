"""What the columns of a table are called in a document of its own."""

_TITLES = {
    "published-analytic": "published, analytic",
    "published-fem": "published, FEM",
    "published-measured": "published, measured",
    "superelement": "FEM 2D, condensed",
    "plane": "FEM 2D",
    "solid": "FEM 3D",
    "virtual": "virtual measurement",
}


def title_of(origin: str) -> str:
    """Return what an origin is called."""
    return _TITLES.get(origin, origin)
