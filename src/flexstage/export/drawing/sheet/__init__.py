"""A technical drawing of a stage on one sheet, as SVG."""

from flexstage.export.drawing.sheet.compose import drawing_svg

__all__ = ["drawing_svg"]
