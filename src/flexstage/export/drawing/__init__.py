"""Drawings for manufacture: contours of the plate, the path of the wire, DXF and SVG."""

from typing import TYPE_CHECKING

from flexstage.lazy import import_on_use

if TYPE_CHECKING:
    from flexstage.export.drawing.contours import Contour, Neck, PlateContours, plate_contours
    from flexstage.export.drawing.cuts import Cut, cuts
    from flexstage.export.drawing.dxf import DXF_LAYERS, dxf_files
    from flexstage.export.drawing.offset import WirePath, offset_contours
    from flexstage.export.drawing.sheet import drawing_svg
    from flexstage.export.drawing.smooth import smooth_notches

__all__ = [
    "DXF_LAYERS",
    "Contour",
    "Cut",
    "Neck",
    "PlateContours",
    "WirePath",
    "cuts",
    "drawing_svg",
    "dxf_files",
    "offset_contours",
    "plate_contours",
    "smooth_notches",
]

import_on_use(__name__)
