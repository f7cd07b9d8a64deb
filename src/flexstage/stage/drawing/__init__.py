"""A stage from a drawing of its contours: bodies and necks by geometry alone."""

#: Endings of the files that are drawings: of contours, and of solids.
DXF, STEP = (".dxf",), (".step", ".stp")
DRAWINGS = (*DXF, *STEP)
