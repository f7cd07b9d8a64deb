"""A stage file with parameters, shared profiles and copies, and how it is broken."""

from tests.golden.broken_cases.ways import Edits, added, without

TEXT = """\
flexstage: 1
length_unit: mm
parameters:
  t: {value: 0.5 mm, description: neck of every notch}
  R: 1.5 mm
  tilt: 4 deg
  legs: 2
  gap: = 2*R
name: row
thickness: = 16*t
material: Al 7075-T6
profiles:
  notch: {kind: circular, neck_thickness: = t, radius: = R}
bodies:
  base: {fixed: true, outline: [[-90, 0], [90, 0], [90, 6], [-90, 6]]}
  leg-left: {outline: [[-22, = 6 mm + gap], [-16, = 6 mm + gap], [-16, 30], [-22, 30]]}
  bar: {outline: [[-85, = 30 mm + gap], [85, = 30 mm + gap], [85, 40], [-85, 40]]}
hinges:
  foot-left: {bodies: [base, leg-left], at: [-19, = 6 mm + R], direction: 90 deg, profile: notch}
  head-left: {bodies: [leg-left, bar], at: [-19, = 30 mm + R], direction: 90 deg, profile: notch}
probes:
  eye: {body: bar, at: [-85, 38], direction: = 2*tilt}
mirror:
  - line: {x: = 2*R - gap}
    of: [leg-left, foot-left, head-left]
    rename: {left: right}
pattern:
  - of: [leg-left, foot-left, head-left]
    count: = legs
    step: [-30, 0]
"""

EDITS: Edits = {
    "parameters as a list": ("gap: = 2*R", "gap: = 2*R\n  - 3"),
    "parameters as a text": (TEXT[TEXT.index("  t:") : TEXT.index("name:")], "  all of them\n"),
    "no parameters": (TEXT[TEXT.index("parameters:") : TEXT.index("name:")], ""),
    "a parameter of nothing": ("R: 1.5 mm", "R:"),
    "a parameter of a list": ("R: 1.5 mm", "R: [1.5 mm]"),
    "a parameter that is true": ("R: 1.5 mm", "R: true"),
    "a parameter of words": ("R: 1.5 mm", "R: as usual"),
    "a parameter of an unknown unit": ("R: 1.5 mm", "R: 1.5 mn"),
    "a parameter without its unit": ("R: 1.5 mm", "R: 1.5"),
    "a parameter of another dimension": ("R: 1.5 mm", "R: 1.5 MPa"),
    "a parameter that is negative": ("R: 1.5 mm", "R: -1.5 mm"),
    "a parameter that is too large": ("R: 1.5 mm", "R: 1e999 mm"),
    "a parameter that is not finite": ("R: 1.5 mm", "R: .inf"),
    "a parameter given twice": ("R: 1.5 mm", "R: 1.5 mm\n  R: 2 mm"),
    "a parameter with a dash": ("tilt:", "til-t:"),
    "a parameter that begins with a digit": ("tilt:", "1tilt:"),
    "a parameter called like a function": ("tilt:", "sqrt:"),
    "a parameter called like a constant": ("tilt:", "pi:"),
    "a description without a value": ("value: 0.5 mm, ", ""),
    "an unknown key of a parameter": ("description:", "remark:"),
    "a list as description": ("description: neck of every notch", "description: [neck]"),
    "an unknown name": ("= 2*tilt", "= 2*tild"),
    "a name of Python": ("= 2*tilt", "= 2*True*tilt"),
    "an attribute": ("= 2*tilt", "= tilt.real"),
    "a call of an unknown function": ("= 2*tilt", "= open(tilt)"),
    "a call of an import": ("= 2*tilt", "= __import__('os')"),
    "an index": ("= 2*tilt", '"= tilt[0]"'),
    "a condition": ("= 2*tilt", "= tilt if 1 else 0"),
    "a text within": ("= 2*tilt", "= 'tilt'"),
    "a caret": ("= 2*tilt", "= tilt^2"),
    "a product without its sign": ("= 2*tilt", "= 2 tilt"),
    "two values": ("= 2*tilt", '"= tilt, tilt"'),
    "an equals sign alone": ("= 2*tilt", '"="'),
    "an open parenthesis": ("= 2*tilt", "= 2*(tilt"),
    "ten thousand parentheses": ("= 2*tilt", "= " + "(" * 10_000 + "tilt" + ")" * 10_000),
    "forty parentheses": ("= 2*tilt", "= " + "(" * 40 + "tilt" + ")" * 40),
    "four hundred signs": ("= 2*tilt", '"= ' + "-" * 400 + 'tilt"'),
    "a huge power": ("= 2*tilt", "= tilt*9**9**9"),
    "a power that is too large": ("= 2*tilt", "= tilt*1e99**99"),
    "a division by zero": ("= 2*tilt", "= tilt/(legs - 2)"),
    "a root of less than nothing": ("= 2*tilt", "= tilt*sqrt(1 - legs)"),
    "an angle for a length": ("= 16*t\n", "= 16*tilt\n"),
    "a number for a length": ("= 16*t\n", "= 16\n"),
    "an area for a length": ("= 16*t\n", "= 16*t*R\n"),
    "a length for an angle": ("= 2*tilt", "= 2*t"),
    "a length for a count": ("= legs", "= R"),
    "a fraction for a count": ("= legs", "= legs/3"),
    "a count of one": ("= legs", "= legs - 1"),
    "a length of nothing": ("= 16*t\n", "= 16*t - 8 mm\n"),
    "a length beyond all": ("= 16*t\n", "= 1e9*t\n"),
    "a sum of two dimensions": ("gap: = 2*R", "gap: = 2*R + tilt"),
    "a parameter that needs itself": ("gap: = 2*R", "gap: = 2*gap"),
    "a circle of two": ("R: 1.5 mm", "R: = gap/2"),
    "a circle of three": ("R: 1.5 mm", "R: = next\n  next: = gap/2"),
    "an expression for a name": ("name: row", "name: = row"),
    "an expression for a word": ("kind: circular", "kind: = circular"),
    "an expression for true": ("fixed: true", "fixed: = 1"),
    "an expression for a material": ("material: Al 7075-T6", "material: = t"),
    "profiles as a list": ("profiles:\n  notch:", "profiles:\n  -"),
    "no profiles": (TEXT[TEXT.index("profiles:") : TEXT.index("bodies:")], ""),
    "a profile of a word": ("notch: {kind: circular, neck_thickness: = t, radius: = R}",
                            "notch: circular"),
    "a profile of an unknown kind": ("kind: circular", "kind: circulr"),
    "a profile that no hinge has": ("profiles:", "profiles:\n  more: {kind: leaf}"),
    "a profile near one": ("direction: 90 deg, profile: notch}\n  head",
                           "direction: 90 deg, profile: notsh}\n  head"),
    "a profile without a name": ("  notch:", '  "":'),
    "a mirror as a mapping": ("mirror:\n  - line", "mirror:\n    line"),
    "a mirror without a line": ("line: {x: = 2*R - gap}\n    of", "of"),
    "a mirror of a line near none": ("line: {x: = 2*R - gap}", "line: diagonal"),
    "a mirror of a line of two places": ("line: {x: = 2*R - gap}", "line: {x: 1, y: 2}"),
    "a mirror of a line of three points": ("line: {x: = 2*R - gap}",
                                           "line: [[0, 0], [1, 1], [2, 2]]"),
    "a mirror of a line of one point": ("line: {x: = 2*R - gap}", "line: [[3, 4], [3, 4]]"),
    "a mirror of what there is not": ("head-left]\n    rename", "haed-left]\n    rename"),
    "a mirror of nothing": ("[leg-left, foot-left, head-left]\n    rename", "[]\n    rename"),
    "a mirror without names": without("    rename: {left: right}"),
    "a mirror by a word that no name has": ("{left: right}", "{lft: right}"),
    "a mirror by a part of a word": ("{left: right}", "{lef: mid}"),
    "a mirror by a list": ("{left: right}", "[left, right]"),
    "a mirror onto what there is": ("{left: right}", "{leg-left: bar, left: right}"),
    "a mirror that gives too long names": ("{left: right}", "{left: " + "r" * 90 + "}"),
    "a pattern without a count": without("    count: = legs"),
    "a pattern without a way": without("    step: [-30, 0]"),
    "a pattern of two ways": added("    turn: 90 deg"),
    "a pattern of a million": ("= legs", "1e6"),
    "a pattern of too few names": added("    rename: {left: []}"),
    "a pattern of a name for names": added("    rename: {left: right}"),
    "a pattern of copies that were made": added("  - {of: [leg-left], count: 2, step: [-30, 0]}"),
    "a pattern of an unknown key": added("    times: 3"),
    "a design as well": added("design: {name: parallelogram}"),
}  # fmt: skip
