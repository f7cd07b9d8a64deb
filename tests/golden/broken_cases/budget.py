"""An uncertainty budget, and how it is broken."""

from tests.golden.broken_cases.ways import Edits, added, without

TEXT = """\
quantity: stroke
unit: um
equation: reading * (1 + gain) / cos(tilt) - offset * pitch
influences:
  - {name: reading, value: 63.12 um, uncertainty: 12 nm, dof: 9, source: ten cycles}
  - {name: gain, value: 0, half_width: 0.1 %, distribution: uniform}
  - {name: tilt, value: 0 mrad, uncertainty: 5 mrad}
  - {name: offset, value: 8 mm, half_width: 0.5 mm}
  - {name: pitch, value: 1.80 urad, uncertainty: 0.02 urad}
correlations:
  - [tilt, pitch, 0.3]
"""

EDITS: Edits = {
    "a key near a known one": ("quantity: stroke", "quantty: stroke"),
    "a key near none": added("zebra: 1"),
    "a key near one of an influence": ("dof: 9", "dofs: 9"),
    "a key given twice": added("unit: nm"),
    "a key of an influence given twice": ("dof: 9", "dof: 9, dof: 8"),
    "two influences of one name": ("name: tilt,", "name: gain,"),
    "no equation": lambda text: "".join(
        line for line in text.splitlines(True) if not line.startswith("equation")
    ),
    "no influences": (TEXT[TEXT.index("influences:") :], ""),
    "influences of nothing": (TEXT[TEXT.index("influences:") :], "influences: []\n"),
    "influences as a mapping": (
        TEXT[TEXT.index("influences:") :],
        "influences: {gain: {value: 0}}\n",
    ),
    "a text as influence": ("  - {name: gain", "  - gain\n  - {name: gain"),
    "an influence without a name": ("name: gain, ", ""),
    "a number as name": ("name: gain", "name: 7"),
    "a list as name": ("name: gain", "name: [gain]"),
    "an influence without a value": ("value: 8 mm, ", ""),
    "an influence without an uncertainty": (", half_width: 0.5 mm", ""),
    "degrees of freedom of a constant": (", half_width: 0.5 mm", ", dof: 3"),
    "two uncertainties": ("half_width: 0.5 mm", "half_width: 0.5 mm, uncertainty: 1 mm"),
    "a text for a value": ("value: 8 mm", "value: wide"),
    "nothing for a value": ("value: 8 mm", "value: null"),
    "true for a value": ("value: 8 mm", "value: true"),
    "a list for a value": ("value: 8 mm", "value: [8 mm]"),
    "a decimal comma": ("value: 8 mm", "value: '8,5 mm'"),
    "a value of two numbers": ("value: 8 mm", "value: 8 9 mm"),
    "an unknown unit": ("value: 8 mm", "value: 8 mmm"),
    "a value without a unit": ("value: 8 mm", "value: 8"),
    "an uncertainty without a unit": ("uncertainty: 12 nm", "uncertainty: 12"),
    "an uncertainty in degrees": ("uncertainty: 12 nm", "uncertainty: 12 deg"),
    "an uncertainty in an unknown unit": ("uncertainty: 12 nm", "uncertainty: 12 nmm"),
    "an uncertainty in %": ("uncertainty: 12 nm", "uncertainty: 0.1 %"),
    "a negative uncertainty": ("uncertainty: 12 nm", "uncertainty: -12 nm"),
    "an uncertainty of zero": ("uncertainty: 12 nm", "uncertainty: 0 nm"),
    "a negative half-width": ("half_width: 0.5 mm", "half_width: -0.5 mm"),
    "a value that is not finite": ("value: 8 mm", "value: inf mm"),
    "a value that is not a number": ("value: 8 mm", "value: nan mm"),
    "a value beyond all": ("value: 8 mm", "value: 8e999 mm"),
    "a value of many digits": ("value: 8 mm", f"value: {'8' * 41} mm"),
    "degrees of freedom as a text": ("dof: 9", "dof: nine"),
    "degrees of freedom in quotes": ("dof: 9", "dof: '9'"),
    "degrees of freedom as a list": ("dof: 9", "dof: [9]"),
    "9.5 degrees of freedom": ("dof: 9", "dof: 9.5"),
    "no degrees of freedom": ("dof: 9", "dof: 0"),
    "negative degrees of freedom": ("dof: 9", "dof: -9"),
    "true degrees of freedom": ("dof: 9", "dof: true"),
    "a distribution near one": ("distribution: uniform", "distribution: unifrm"),
    "a distribution that has no half-width": ("distribution: uniform", "distribution: normal"),
    "a list as distribution": ("distribution: uniform", "distribution: [uniform]"),
    "a kind that is none": ("dof: 9", "kind: C"),
    "a share that is none": ("distribution: uniform", "distribution: trapezoidal, flat_share: 2"),
    "a unit that is none": ("unit: um", "unit: umm"),
    "a unit of a force for a length": ("unit: um", "unit: N"),
    "no unit": without("unit: um"),
    "a list as unit": ("unit: um", "unit: [um]"),
    "an equation of a name that is not there": ("cos(tilt)", "cos(tlt)"),
    "an equation of a function that is not there": ("cos(tilt)", "coss(tilt)"),
    "an equation that is not closed": ("cos(tilt)", "cos(tilt"),
    "an equation of nothing": (" reading * (1 + gain) / cos(tilt) - offset * pitch", ""),
    "a number as equation": (" reading * (1 + gain) / cos(tilt) - offset * pitch", " 7"),
    "a list as equation": (" reading * (1 + gain) / cos(tilt) - offset * pitch", " [1, 2]"),
    "an equation that is code": (
        " reading * (1 + gain) / cos(tilt) - offset * pitch",
        " __import__('os')",
    ),
    "an equation that adds lengths to angles": ("offset * pitch", "offset + pitch"),
    "an influence that is not used": (" - offset * pitch", " - offset * tilt"),
    "a correlation of two": ("[tilt, pitch, 0.3]", "[tilt, pitch]"),
    "a text as correlation": ("[tilt, pitch, 0.3]", "strong"),
    "correlations of nothing": ("  - [tilt, pitch, 0.3]\n", "  []\n"),
    "a correlation of a name that is not there": ("[tilt, pitch, 0.3]", "[tlt, pitch, 0.3]"),
    "a correlation with itself": ("[tilt, pitch, 0.3]", "[tilt, tilt, 0.3]"),
    "a correlation given twice": added("  - [pitch, tilt, 0.3]"),
    "a correlation of 1.5": ("[tilt, pitch, 0.3]", "[tilt, pitch, 1.5]"),
    "a correlation as a text": ("[tilt, pitch, 0.3]", "[tilt, pitch, strong]"),
    "a list in a correlation": ("[tilt, pitch, 0.3]", "[[tilt], pitch, 0.3]"),
}
