"""A design in a stage file, and how it is broken."""

from tests.golden.broken_cases.ways import Edits, added, without

TEXT = """\
flexstage: 1
design:
  name: nested-xy
  based_on: vgtu-piezo
  thickness: 15 mm
  material: Al 7075-T6
  x:
    lever_neck: 0.5 mm
    actuator:
      kind: piezo
      free_stroke: 25 um
      voltage_range: [0 V, 120 V]
"""

EDITS: Edits = {
    "no version": without("flexstage: 1"),
    "a key beside the design": added("thickness: 8 mm"),
    "a text for the design": lambda _: "flexstage: 1\ndesign: parallelogram\n",
    "a design without a name": without("  name: nested-xy"),
    "a list as name": ("name: nested-xy", "name: [nested-xy]"),
    "a number as name": ("name: nested-xy", "name: 7"),
    "a name near one": ("name: nested-xy", "name: nested-xyz"),
    "a name near none": ("name: nested-xy", "name: hexapod"),
    "a base near one": ("based_on: vgtu-piezo", "based_on: vgtu-pieso"),
    "a base of another family": ("based_on: vgtu-piezo", "based_on: parallelogram"),
    "a number as base": ("based_on: vgtu-piezo", "based_on: 7"),
    "a list as base": ("based_on: vgtu-piezo", "based_on: [vgtu-piezo]"),
    "no base": without("  based_on: vgtu-piezo"),
    "a base of a built-in design": ("name: nested-xy", "name: vgtu-piezo"),
    "a parameter near one": ("  thickness: 15 mm", "  thickness_: 15 mm"),
    "a parameter near none": ("  thickness: 15 mm", "  zebra: 15 mm"),
    "a nested parameter near one": ("lever_neck: 0.5 mm", "lever_nek: 0.5 mm"),
    "a parameter of an actuator near one": ("free_stroke: 25 um", "free_strok: 25 um"),
    "a parameter of another actuator": ("free_stroke: 25 um", "pitch: 1 mm"),
    "a parameter given twice": added("  thickness: 16 mm"),
    "a text for a length": ("thickness: 15 mm", "thickness: thick"),
    "nothing for a length": ("thickness: 15 mm", "thickness:"),
    "true for a length": ("thickness: 15 mm", "thickness: true"),
    "a list for a length": ("thickness: 15 mm", "thickness: [15 mm]"),
    "a mapping for a length": ("thickness: 15 mm", "thickness: {value: 15 mm}"),
    "a length without a unit": ("thickness: 15 mm", "thickness: 15"),
    "a length without a unit, with one for all": lambda text: text.replace(
        "thickness: 15 mm", "thickness: 15"
    ).replace("design:", "length_unit: mm\ndesign:"),
    "an unknown unit": ("thickness: 15 mm", "thickness: 15 mmm"),
    "a unit of a force for a length": ("thickness: 15 mm", "thickness: 15 N"),
    "a unit of a force for a nested length": ("lever_neck: 0.5 mm", "lever_neck: 0.5 N"),
    "a nested length without a unit": ("lever_neck: 0.5 mm", "lever_neck: 0.5"),
    "a negative thickness": ("thickness: 15 mm", "thickness: -15 mm"),
    "a thickness of zero": ("thickness: 15 mm", "thickness: 0 mm"),
    "a thickness that is not finite": ("thickness: 15 mm", "thickness: inf mm"),
    "a thickness that is not a number": ("thickness: 15 mm", "thickness: nan mm"),
    "a negative neck": ("lever_neck: 0.5 mm", "lever_neck: -0.5 mm"),
    "a neck that cannot be": ("lever_neck: 0.5 mm", "lever_neck: 500 mm"),
    "a text for nested parameters": (TEXT[TEXT.index("  x:") :], "  x: wide\n"),
    "a list for nested parameters": (TEXT[TEXT.index("  x:") :], "  x: [1 mm]\n"),
    "nothing for nested parameters": (TEXT[TEXT.index("  x:") :], "  x:\n"),
    "a kind of actuator near one": ("kind: piezo", "kind: pieso"),
    "a list as kind of actuator": ("kind: piezo", "kind: [piezo]"),
    "another actuator in half": (
        TEXT[TEXT.index("      kind:") :],
        "      kind: screw\n      pitch: 1 mm\n",
    ),
    "a text for an actuator": (TEXT[TEXT.index("    actuator:") :], "    actuator: piezo\n"),
    "a range of three": ("[0 V, 120 V]", "[0 V, 60 V, 120 V]"),
    "a range in one value": ("[0 V, 120 V]", "120 V"),
    "a range in mm": ("[0 V, 120 V]", "[0 V, 120 mm]"),
    "a range without a unit": ("[0 V, 120 V]", "[0, 120]"),
    "a range that falls": ("[0 V, 120 V]", "[120 V, 0 V]"),
    "a negative stroke": ("free_stroke: 25 um", "free_stroke: -25 um"),
    "a material near one": ("material: Al 7075-T6", "material: Al 7075-T5"),
    "a number as material": ("material: Al 7075-T6", "material: 7"),
    "a key of a material near one": ("material: Al 7075-T6", "material: {densty: 2700 kg/m^3}"),
    "a ratio with a unit": ("material: Al 7075-T6", "material: {poissons_ratio: 0.3 mm}"),
    "a ratio as a text": ("material: Al 7075-T6", "material: {poissons_ratio: third}"),
    "a ratio of 0.7": ("material: Al 7075-T6", "material: {poissons_ratio: 0.7}"),
    "a number as name of a material": ("material: Al 7075-T6", "material: {name: 7}"),
}
