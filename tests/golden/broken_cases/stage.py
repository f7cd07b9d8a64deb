"""A stage file, and how it is broken."""

from tests.golden.broken_cases.ways import Edits, added, without

TEXT = """\
flexstage: 1
length_unit: mm
name: lever
thickness: 8 mm
material: Al 7075-T6
bodies:
  base:
    fixed: true
    outline: [[0, 0], [40, 0], [40, 6], [0, 6]]
    mounting_holes:
      - {centre: [34, 3], radius: 1.6}
  arm:
    outline:
      - [3, 9]
      - [9, 9]
      - [9, 40]
      - {to: [3, 40], through: [6, 43]}
    extra_masses:
      - {mass: 35 g, at: [6, 38], inertia: 4200 g*mm^2}
hinges:
  pivot:
    bodies: [base, arm]
    at: [6, 7.5]
    direction: 90 deg
    profile: {kind: circular, neck_thickness: 0.6, radius: 1.5}
drives:
  stack:
    kind: piezo
    pushes: arm
    reacts: base
    at: [[9, 30], [20, 6]]
    direction: 180 deg
    free_stroke: 15 um
    stiffness: 40 N/um
    voltage_range: [0 V, 120 V]
probes:
  tip: {body: arm, at: [9, 40], direction: 0 deg}
axes:
  x: {drive: stack, probe: tip}
published:
  - {quantity: natural_frequency_hz, axis: x, origin: measured, value: 483.9 Hz}
"""

EDITS: Edits = {
    "no version": without("flexstage: 1"),
    "a version to come": ("flexstage: 1", "flexstage: 2"),
    "version 1.5": ("flexstage: 1", "flexstage: 1.5"),
    "the version as a text": ("flexstage: 1", "flexstage: '1'"),
    "the version as true": ("flexstage: 1", "flexstage: true"),
    "the version as a list": ("flexstage: 1", "flexstage: [1]"),
    "an unknown unit of lengths": ("length_unit: mm", "length_unit: mn"),
    "a list as unit of lengths": ("length_unit: mm", "length_unit: [mm]"),
    "a key near a known one": ("thickness: 8", "thickness_: 8"),
    "a key near one of a body": ("fixed: true", "fixd: true"),
    "a key near one of a profile": ("neck_thickness:", "neck_thikness:"),
    "a key near none": added("zebra: 1"),
    "a key given twice": added("name: other"),
    "two bodies of one name": ("  arm:\n", "  base:\n"),
    "no name": without("name: lever"),
    "no thickness": without("thickness: 8 mm"),
    "no material": without("material: Al 7075-T6"),
    "no bodies": (TEXT[TEXT.index("bodies:") :], ""),
    "bodies of nothing": (TEXT[TEXT.index("  base:") :], ""),
    "a hinge without a direction": without("    direction: 90 deg"),
    "a profile without a radius": (", radius: 1.5}", "}"),
    "a profile without a kind": ("kind: circular, ", ""),
    "a kind of profile near one": ("kind: circular", "kind: circulr"),
    "a kind of drive near none": ("kind: piezo", "kind: steam"),
    "a drive without a kind": without("    kind: piezo"),
    "a key of another kind of drive": ("free_stroke: 15 um", "free_stroke: 15 um\n    pitch: 1"),
    "a text for a length": ("thickness: 8 mm", "thickness: thick"),
    "nothing for a length": ("thickness: 8 mm", "thickness:"),
    "true for a length": ("thickness: 8 mm", "thickness: true"),
    "a list for a length": ("thickness: 8 mm", "thickness: [8 mm]"),
    "a mapping for a length": ("thickness: 8 mm", "thickness: {value: 8 mm}"),
    "a decimal comma": ("thickness: 8 mm", "thickness: 8,5 mm"),
    "two numbers for a length": ("thickness: 8 mm", "thickness: 8 9 mm"),
    "an unknown unit": ("thickness: 8 mm", "thickness: 8 mmm"),
    "a unit in capitals": ("thickness: 8 mm", "thickness: 8 MM"),
    "a unit of a force for a length": ("thickness: 8 mm", "thickness: 8 N"),
    "a unit of a length for an angle": ("direction: 90 deg", "direction: 90 mm"),
    "an angle without a unit": ("direction: 90 deg", "direction: 90"),
    "a stiffness without a unit": ("stiffness: 40 N/um", "stiffness: 40"),
    "a stiffness in a unit of force": ("stiffness: 40 N/um", "stiffness: 40 N"),
    "no unit of lengths": without("length_unit: mm"),
    "a negative thickness": ("thickness: 8 mm", "thickness: -8 mm"),
    "a thickness of zero": ("thickness: 8 mm", "thickness: 0 mm"),
    "a thickness that is not finite": ("thickness: 8 mm", "thickness: inf mm"),
    "a thickness that is not a number": ("thickness: 8 mm", "thickness: nan mm"),
    "a thickness of 1 km": ("thickness: 8 mm", "thickness: 1e6 mm"),
    "a length of 1 fm": ("thickness: 8 mm", "thickness: 1e-12 mm"),
    "a negative radius": ("radius: 1.5}", "radius: -1.5}"),
    "a negative stiffness": ("stiffness: 40", "stiffness: -40"),
    "a negative mass": ("mass: 35 g", "mass: -35 g"),
    "a number for a name": ("name: lever", "name: 7"),
    "nothing for a name": ("name: lever", "name:"),
    "a list for a name": ("name: lever", "name: [lever]"),
    "a name of two lines": ("name: lever", 'name: "lev\\ner"'),
    "a text for true": ("fixed: true", "fixed: yes"),
    "a number for true": ("fixed: true", "fixed: 1"),
    "a text for a body": ("  arm:\n", "  leg: none\n  arm:\n"),
    "a list of bodies": (TEXT[TEXT.index("bodies:") : TEXT.index("hinges:")], "bodies: [a]\n"),
    "a point of three": ("- [9, 9]", "- [9, 9, 9]"),
    "a point of one": ("- [9, 9]", "- [9]"),
    "a text for a point": ("- [9, 9]", "- here"),
    "an outline of two points": ("[[0, 0], [40, 0], [40, 6], [0, 6]]", "[[0, 0], [40, 0]]"),
    "an outline of no list": ("[[0, 0], [40, 0], [40, 6], [0, 6]]", "square"),
    "the same point twice": ("[40, 6], [0, 6]]", "[40, 6], [40, 6], [0, 6]]"),
    "an arc with another key": ("through: [6, 43]", "throughh: [6, 43]"),
    "an arc to nowhere": ("to: [3, 40], through", "through"),
    "an arc through its own end": ("through: [6, 43]", "through: [3, 40]"),
    "a bulge with a unit": ("through: [6, 43]", "bulge: 1 mm"),
    "a hole of three keys": ("radius: 1.6", "radius: 1.6, depth: 3"),
    "a range of three": ("[0 V, 120 V]", "[0 V, 60 V, 120 V]"),
    "a range that falls": ("[0 V, 120 V]", "[120 V, 0 V]"),
    "a range in one value": ("[0 V, 120 V]", "120 V"),
    "a hinge of three bodies": ("bodies: [base, arm]", "bodies: [base, arm, arm]"),
    "a hinge of one body twice": ("bodies: [base, arm]", "bodies: [arm, arm]"),
    "a hinge at a body that is not there": ("bodies: [base, arm]", "bodies: [base, armm]"),
    "a drive of a body that is not there": ("pushes: arm", "pushes: am"),
    "a probe of a body that is not there": ("tip: {body: arm", "tip: {body: lever"),
    "an axis of a drive that is not there": ("drive: stack", "drive: stak"),
    "an axis of a probe that is not there": ("probe: tip", "probe: top"),
    "a figure of an axis that is not there": ("axis: x, origin", "axis: z, origin"),
    "a material near one": ("material: Al 7075-T6", "material: Al 7075-T5"),
    "a material near none": ("material: Al 7075-T6", "material: cheese"),
    "a material in half": ("material: Al 7075-T6", "material: {name: x, density: 2700 kg/m^3}"),
    "a material with a wrong ratio": (
        "material: Al 7075-T6",
        "material: {name: x, youngs_modulus: 70 GPa, poissons_ratio: 0.7, density: 2700 kg/m^3, "
        "yield_strength: 400 MPa}",
    ),
    "a ratio with a unit": (
        "material: Al 7075-T6",
        "material: {name: x, youngs_modulus: 70 GPa, poissons_ratio: 30 %, density: 2700 kg/m^3, "
        "yield_strength: 400 MPa}",
    ),
    "a quantity near one": ("quantity: natural_frequency_hz", "quantity: natural_frequency"),
    "a figure without a quantity": ("quantity: natural_frequency_hz, ", ""),
    "a figure without a unit": ("value: 483.9 Hz", "value: 483.9"),
    "a figure in rad/s": ("value: 483.9 Hz", "value: 483.9 rad/s"),
    "a figure of unknown origin": ("origin: measured", "origin: guessed"),
    "a design beside bodies": added("design: {name: parallelogram}"),
}
