"""Endings of the files that are drawings."""

#: Those of drawings of contours, and of solids.
DXF, STEP = (".dxf",), (".step", ".stp")
DRAWINGS = (*DXF, *STEP)
