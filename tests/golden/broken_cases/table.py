"""A description of a rotary table, and ways to break it."""

from tests.golden.broken_cases.ways import Edits, added, without

TEXT = """\
table: 1
name: comparator
scale:
  kind: disc
  radius: 48 mm
  diameter: 100 mm
  eccentricity: 50 um
  graduation: [{order: 3, amplitude: 0.2 arcsec}]
heads: {angles: [0 deg, 180 deg], noise: 0.1 arcsec}
axis: {radial_synchronous: 0.1 um, speed: 10 rpm}
mounting_angle: 30 deg
space: {diameter: 320 mm}
tolerance: {error: 2 arcsec, reading: each, eccentricity: 0.3 um}
"""

EDITS: Edits = {
    "no version": without("table: 1"),
    "a version to come": ("table: 1", "table: 2"),
    "a key near none": added("zebra: 1"),
    "no heads": ("angles: [0 deg, 180 deg]", "angles: []"),
    "heads without a unit": ("[0 deg, 180 deg]", "[0, 180]"),
    "a scale that does not surround the axis": ("eccentricity: 50 um", "eccentricity: 60 mm"),
    "a disc smaller than where it is read": ("diameter: 100 mm", "diameter: 90 mm"),
    "a magnet": ("kind: disc", "kind: magnet"),
    "a length for an angle": ("error: 2 arcsec", "error: 2 um"),
    "a tolerance of nothing": ("error: 2 arcsec", "error: 0 arcsec"),
    "an unknown reading": ("reading: each", "reading: both"),
    "half an order": ("order: 3", "order: 2.5"),
    "a speed in hertz": ("10 rpm", "10 Hz"),
    "a key near a known one": ("reading: each", "readings: each"),
    "no tolerance": ("tolerance: {error: 2 arcsec, reading: each, eccentricity: 0.3 um}\n", ""),
}
