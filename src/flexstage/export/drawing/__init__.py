"""Drawings for manufacture: contours of the plate, the path of the wire, DXF and SVG."""
