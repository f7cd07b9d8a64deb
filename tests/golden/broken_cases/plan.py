"""A plan, and how it is broken."""

from tests.golden.broken_cases.ways import Edits, added, without

TEXT = """\
plan: 1
title: loops and motion
stage: vgtu-piezo
sensors:
  x: {channel: 1, calibration: 0.0005, alignment: 1 mrad, drift: 2e-11}
  tilt: {channel: 5, unit: rad}
defaults: {sample_rate: 1 kHz}
steps:
  - name: loops
    excite: {kind: cycles, axis: x, rate: 1 Hz, cycles: 4, shape: cosine}
  - name: motion
    measure: {of: loops, test: motion, along: x, yaw: tilt}
  - name: record
    excite: {kind: designed, axis: x, rates: [0.5 Hz, 5 Hz], seed: 3}
  - {name: taken, measure: {of: record, along: x}}
  - {name: model, identify: {of: [taken], output: x, model: [preisach]}}
  - {name: check, verify: {model: model, along: x, control_modes: [open loop, inverse]}}
  - {name: figures, characterise: {of: [motion]}}
notes: [made on a quiet day in winter]
"""

EDITS: Edits = {
    "no version": without("plan: 1"),
    "a version to come": ("plan: 1", "plan: 2"),
    "version 1.5": ("plan: 1", "plan: 1.5"),
    "the version as a text": ("plan: 1", "plan: '1'"),
    "the version as true": ("plan: 1", "plan: true"),
    "a key near a known one": ("defaults:", "default:"),
    "a key near none": added("zebra: 1"),
    "a key near one of a sensor": ("calibration:", "calibraton:"),
    "a key near one of an excitation": ("cycles: 4", "cycle: 4"),
    "a key near one of a measurement": ("along: x, yaw", "alongg: x, yaw"),
    "a verb near one": ("    measure: {of: loops", "    measur: {of: loops"),
    "a key given twice": added("stage: vgtu-piezo"),
    "two sensors of one name": ("  tilt: {", "  x: {"),
    "two steps of one name": ("name: record", "name: loops"),
    "two steps that differ in capitals": ("name: record", "name: Loops"),
    "no stage": without("stage: vgtu-piezo"),
    "a stage near one": ("stage: vgtu-piezo", "stage: vgtu-pieso"),
    "a stage in no file": ("stage: vgtu-piezo", "stage: none.yaml"),
    "a list as stage": ("stage: vgtu-piezo", "stage: [vgtu-piezo]"),
    "nothing as stage": ("stage: vgtu-piezo", "stage:"),
    "no steps": (TEXT[TEXT.index("steps:") : TEXT.index("notes:")], ""),
    "steps of nothing": (TEXT[TEXT.index("steps:") : TEXT.index("notes:")], "steps: []\n"),
    "steps as a mapping": (
        TEXT[TEXT.index("steps:") : TEXT.index("notes:")],
        "steps: {loops: {excite: {kind: dwell}}}\n",
    ),
    "a text as step": ("  - name: loops\n", "  - loops\n  - name: loops\n"),
    "a step without a name": ("{name: taken, ", "{"),
    "a step without a verb": ("{name: taken, measure: {of: record, along: x}}", "{name: taken}"),
    "a step of two verbs": ("of: record, along: x}}", "of: record, along: x}, identify: {}}"),
    "a text as options": ("measure: {of: record, along: x}", "measure: record"),
    "a number as name of a step": ("{name: taken,", "{name: [7],"),
    "a slash in the name of a step": ("{name: taken,", "{name: a/b,"),
    "an empty name of a step": ("{name: taken,", "{name: '',"),
    "an excitation without a kind": ("kind: cycles, ", ""),
    "a kind of excitation near one": ("kind: cycles", "kind: cycle"),
    "a kind of excitation near none": ("kind: cycles", "kind: thunder"),
    "a list as kind of excitation": ("kind: cycles", "kind: [cycles]"),
    "an excitation without a rate": ("rate: 1 Hz, ", ""),
    "a measurement without a source": ("of: record, ", ""),
    "a text for a rate": ("rate: 1 Hz, ", "rate: fast, "),
    "a rate without a unit": ("rate: 1 Hz, ", "rate: 1, "),
    "a rate in um": ("rate: 1 Hz, ", "rate: 1 um, "),
    "a rate in an unknown unit": ("rate: 1 Hz, ", "rate: 1 hertzz, "),
    "a rate in rad/s": ("rate: 1 Hz, ", "rate: 1 rad/s, "),
    "a negative rate": ("rate: 1 Hz, ", "rate: -1 Hz, "),
    "a rate of zero": ("rate: 1 Hz, ", "rate: 0 Hz, "),
    "a rate that is not finite": ("rate: 1 Hz, ", "rate: inf Hz, "),
    "a list for a rate": ("rate: 1 Hz, ", "rate: [1 Hz], "),
    "a rate for rates": ("rates: [0.5 Hz, 5 Hz]", "rates: 5 Hz"),
    "a rate among rates without a unit": ("rates: [0.5 Hz, 5 Hz]", "rates: [0.5 Hz, 5]"),
    "a rate of zero among rates": ("rates: [0.5 Hz, 5 Hz]", "rates: [0 Hz, 5 Hz]"),
    "a voltage that falls": ("seed: 3}", "voltage: [90 V, 20 V]}"),
    "a default sample rate of zero": (
        "defaults: {sample_rate: 1 kHz}",
        "defaults: {sample_rate: 0 kHz}",
    ),
    "defaults as a list": ("defaults: {sample_rate: 1 kHz}", "defaults: [1 kHz]"),
    "2.5 cycles": ("cycles: 4", "cycles: 2.5"),
    "cycles as a text": ("cycles: 4", "cycles: four"),
    "cycles in quotes": ("cycles: 4", "cycles: '4'"),
    "cycles with a unit": ("cycles: 4", "cycles: 4 Hz"),
    "4.0 cycles": ("cycles: 4", "cycles: 4.0"),
    "no cycles": ("cycles: 4", "cycles: 0"),
    "two cycles for a motion": ("cycles: 4", "cycles: 2"),
    "true cycles": ("cycles: 4", "cycles: true"),
    "a shape near one": ("shape: cosine", "shape: cosin"),
    "a number for a shape": ("shape: cosine", "shape: 7"),
    "a low end that is none": ("cycles: 4", "cycles: 4, low: 1.5"),
    "a text for true": ("cycles: 4", "cycles: 4, closed_loop: yes"),
    "seed 1e3": ("seed: 3", "seed: 1e3"),
    "seed 1.5": ("seed: 3", "seed: 1.5"),
    "a negative seed": ("seed: 3", "seed: -3"),
    "channel 1.5": ("channel: 1,", "channel: 1.5,"),
    "channel 0": ("channel: 1,", "channel: 0,"),
    "channel as a text": ("channel: 1,", "channel: one,"),
    "a sensor without a channel": ("channel: 1, ", ""),
    "a sensor in um": ("unit: rad", "unit: um"),
    "a number for a unit": ("unit: rad", "unit: 5"),
    "a negative calibration": ("calibration: 0.0005", "calibration: -0.0005"),
    "a calibration with a unit": ("calibration: 0.0005", "calibration: 0.05 %"),
    "an alignment without a unit": ("alignment: 1 mrad", "alignment: 0.001"),
    "an alignment in mm": ("alignment: 1 mrad", "alignment: 1 mm"),
    "a drift with a unit": ("drift: 2e-11", "drift: 20 pm/s"),
    "sensors as a list": (
        TEXT[TEXT.index("sensors:") : TEXT.index("defaults:")],
        "sensors: [x, tilt]\n",
    ),
    "a text as sensor": ("tilt: {channel: 5, unit: rad}", "tilt: 5"),
    "a test near one": ("test: motion", "test: moton"),
    "a test that is none of a plan": ("test: motion", "test: spheres"),
    "a test without its sensor": ("along: x, yaw", "yaw"),
    "a step that is not there": ("of: loops", "of: lops"),
    "a step that comes later": ("of: loops", "of: record"),
    "a sensor that is not there": ("yaw: tilt", "yaw: tlt"),
    "a model that is not there": ("model: [preisach]", "model: [preisch]"),
    "a text for model": ("model: [preisach]", "model: preisach"),
    "a record of another verb": ("of: [taken]", "of: [loops]"),
    "a sensor that was not recorded": ("of: [taken], output: x", "of: [taken], output: tilt"),
    "a model of a step of another verb": ("verify: {model: model", "verify: {model: taken"),
    "a way that is none": (
        "control_modes: [open loop, inverse]",
        "control_modes: [open loop, inverrse]",
    ),
    "a way given twice": (
        "control_modes: [open loop, inverse]",
        "control_modes: [inverse, inverse]",
    ),
    "trials that are not whole": ("control_modes: [open loop, inverse]", "trials: 2.5"),
    "a figure evaluated twice": (
        "characterise: {of: [motion]}",
        "characterise: {of: [motion, motion]}",
    ),
    "a record that is no test": ("characterise: {of: [motion]}", "characterise: {of: [taken]}"),
    "a band of three": (
        "{of: record, along: x}",
        "{of: record, along: x, band: [1 Hz, 2 Hz, 3 Hz]}",
    ),
    "a band that falls": ("{of: record, along: x}", "{of: record, along: x, band: [9 Hz, 2 Hz]}"),
    "1.5 modes": ("{of: record, along: x}", "{of: record, along: x, modes: 1.5}"),
    "a confidence of 95": ("{of: record, along: x}", "{of: record, along: x, confidence: 95}"),
    "a text for notes": ("notes: [made on a quiet day in winter]", "notes: quiet"),
}
