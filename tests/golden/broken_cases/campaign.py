"""A campaign, and how it is broken."""

from tests.golden.broken_cases.ways import Edits, added, without

TEXT = """\
campaign: 1
stage: vgtu-mechanical
instruments:
  probe: {calibration: 0.0005, alignment: 1 mrad, resolution_step: 1 nm}
  clock: {time_base: 5e-5}
tests:
  cycles-x:
    test: motion
    axis: x
    records: [cycles.csv]
    columns: {command: command, along: along, across: across}
    along: probe
    smallest_step: 0.49 um
  hammer-x:
    test: response
    axis: x
    records: [hit1.csv, hit2.csv]
    columns: {input: force, output: [ax, ay]}
    reading: {sample_rate: 2 kHz, delimiter: ;}
    excitation: hammer
    band: [80 Hz, 1.3 kHz]
    modes: 2
    confidence: 0.9
notes: [made on a quiet day]
"""

EDITS: Edits = {
    "no version": without("campaign: 1"),
    "a version to come": ("campaign: 1", "campaign: 2"),
    "the version as a text": ("campaign: 1", "campaign: '1'"),
    "the version as a list": ("campaign: 1", "campaign: [1]"),
    "a key near a known one": ("instruments:", "instrumnts:"),
    "a key near none": added("zebra: 1"),
    "a key near one of an instrument": ("calibration:", "calibraton:"),
    "a key near one of a test": ("excitation: hammer", "excitaton: hammer"),
    "a key near one of the columns": ("across: across", "acros: across"),
    "a key near one of the reading": ("delimiter: ;", "delimitr: ;"),
    "a key given twice": added("stage: other"),
    "two tests of one name": ("  hammer-x:", "  cycles-x:"),
    "two instruments of one name": ("  clock: {", "  probe: {"),
    "no tests": (TEXT[TEXT.index("tests:") : TEXT.index("notes:")], ""),
    "tests of nothing": (
        TEXT[TEXT.index("tests:") : TEXT.index("notes:")],
        "tests: {}\n",
    ),
    "tests as a list": (
        TEXT[TEXT.index("tests:") : TEXT.index("notes:")],
        "tests: [cycles-x]\n",
    ),
    "a text as test": (TEXT[TEXT.index("  hammer-x:") :], "  hammer-x: hit.csv\n"),
    "a test without a kind": without("    test: motion"),
    "a test without records": without("    records: [cycles.csv]"),
    "a test of no records": ("records: [cycles.csv]", "records: []"),
    "a test without an axis": ("    test: motion\n    axis: x\n", "    test: motion\n"),
    "an empty axis": ("    test: motion\n    axis: x\n", "    test: motion\n    axis: ''\n"),
    "a kind of test near one": ("test: motion", "test: moton"),
    "a number as kind of test": ("test: motion", "test: 7"),
    "a list as kind of test": ("test: motion", "test: [motion]"),
    "an excitation near one": ("excitation: hammer", "excitation: hamer"),
    "a text for records": ("records: [cycles.csv]", "records: cycles.csv"),
    "a list among records": ("records: [cycles.csv]", "records: [[cycles.csv]]"),
    "a text for columns": (
        "columns: {command: command, along: along, across: across}",
        "columns: all",
    ),
    "a list for a column": ("across: across", "across: [across]"),
    "a column for columns": ("output: [ax, ay]", "output: ax"),
    "an instrument near one": ("along: probe", "along: prob"),
    "an instrument near none": ("along: probe", "along: ruler"),
    "a list as instrument": ("along: probe", "along: [probe]"),
    "no instruments": (
        TEXT[TEXT.index("instruments:") : TEXT.index("tests:")],
        "",
    ),
    "instruments as a list": (
        TEXT[TEXT.index("instruments:") : TEXT.index("tests:")],
        "instruments: [probe]\n",
    ),
    "a text as instrument": ("clock: {time_base: 5e-5}", "clock: good"),
    "a negative calibration": ("calibration: 0.0005", "calibration: -0.0005"),
    "a calibration with a unit": ("calibration: 0.0005", "calibration: 0.05 %"),
    "a calibration as a text": ("calibration: 0.0005", "calibration: good"),
    "a calibration in quotes": ("calibration: 0.0005", "calibration: '0.0005'"),
    "an alignment without a unit": ("alignment: 1 mrad", "alignment: 0.001"),
    "an alignment in mm": ("alignment: 1 mrad", "alignment: 1 mm"),
    "a step in an unknown unit": ("resolution_step: 1 nm", "resolution_step: 1 nmm"),
    "a step without a unit": ("smallest_step: 0.49 um", "smallest_step: 0.49"),
    "a negative step": ("smallest_step: 0.49 um", "smallest_step: -0.49 um"),
    "a step of zero": ("smallest_step: 0.49 um", "smallest_step: 0 um"),
    "a step that is not finite": ("smallest_step: 0.49 um", "smallest_step: inf um"),
    "a band of one": ("band: [80 Hz, 1.3 kHz]", "band: [80 Hz]"),
    "a band that falls": ("band: [80 Hz, 1.3 kHz]", "band: [80 Hz, 1.3 Hz]"),
    "a band without units": ("band: [80 Hz, 1.3 kHz]", "band: [80, 1300]"),
    "a band in one value": ("band: [80 Hz, 1.3 kHz]", "band: 80 Hz"),
    "2.5 modes": ("modes: 2", "modes: 2.5"),
    "modes as a text": ("modes: 2", "modes: two"),
    "modes with a unit": ("modes: 2", "modes: 2 Hz"),
    "true modes": ("modes: 2", "modes: true"),
    "no modes": ("modes: 2", "modes: 0"),
    "a confidence of 90": ("confidence: 0.9", "confidence: 90"),
    "a confidence with a unit": ("confidence: 0.9", "confidence: 90 %"),
    "a rate without a unit": ("sample_rate: 2 kHz", "sample_rate: 2000"),
    "a rate in mm": ("sample_rate: 2 kHz", "sample_rate: 2 mm"),
    "a negative rate": ("sample_rate: 2 kHz", "sample_rate: -2 kHz"),
    "2.5 lines to skip": ("delimiter: ;", "skip_lines: 2.5"),
    "lines to skip as a text": ("delimiter: ;", "skip_lines: two"),
    "3 lines to skip": ("delimiter: ;", "skip_lines: 3"),
    "a text for true": ("excitation: hammer", "excitation: hammer\n    deviations: yes"),
    "an origin that is none": added("origin: guessed"),
    "a cycle that is none": ("excitation: hammer", "excitation: hammer\n    cycle: round"),
    "a list as stage": ("stage: vgtu-mechanical", "stage: [vgtu-mechanical]"),
    "a stage near one": ("stage: vgtu-mechanical", "stage: vgtu-mechnical"),
    "a text for notes": ("notes: [made on a quiet day]", "notes: quiet"),
}
