"""A technical drawing of a stage on one sheet, as SVG."""
