"""The file of a hysteresis model, and how it is broken."""

import numpy as np

from flexstage.hysteresis import DriveModel, PrandtlIshlinskii
from flexstage.hysteresis.chain.creep import LogCreep
from flexstage.hysteresis.chain.lag import Lag
from flexstage.hysteresis.chain.stage_modes import StageModes
from flexstage.hysteresis.drive_model import ValidityRange
from flexstage.hysteresis.model_file import ModelFile, model_text
from tests.golden.broken_cases.ways import Edits, added, without

TEXT = model_text(
    ModelFile(
        model=DriveModel(
            hysteresis=PrandtlIshlinskii(
                gain=0.4e-6, thresholds=np.array([2.0, 9.0]), weights=np.array([0.1e-6, 0.15e-6])
            ),
            creep=LogCreep(rate_per_decade=0.012),
            modes=StageModes(frequency_hz=(320.9,), damping_ratio=(0.011,)),
            lag=Lag(delay=0.0047),
            offset=-3.1e-6,
            validity=ValidityRange(
                input_range=(0.0, 117.0), output_range=(0.0, 3e-5), rate_range_hz=(0.7, 8.0)
            ),
        ),
        provenance={"records": [{"file": "a.csv"}]},
    )
)

EDITS: Edits = {
    "no version": ("flexstage-drive-model: 1\n", ""),
    "a version to come": ("flexstage-drive-model: 1", "flexstage-drive-model: 2"),
    "version 1.5": ("flexstage-drive-model: 1", "flexstage-drive-model: 1.5"),
    "the version as a text": ("flexstage-drive-model: 1", "flexstage-drive-model: '1'"),
    "the version as true": ("flexstage-drive-model: 1", "flexstage-drive-model: true"),
    "the version as a list": ("flexstage-drive-model: 1", "flexstage-drive-model: [1]"),
    "a key near none": added("zebra: 1"),
    "a section near a known one": ("\nhysteresis:", "\nhysteresi:"),
    "a section near a known one that may be left out": ("\nvalidity:", "\nvalidty:"),
    "no chain": ("\nchain:", "\nchains:"),
    "no output": ("\noutput:", "\noutputs:"),
    "no input": ("\ninput:", "\ninputs:"),
    "a key near one of the hysteresis": ("gain: 4.0e-07", "gan: 4.0e-07"),
    "a key near one of an element": ("delay: 0.0047", "delay: 0.0047, dely: 1.0"),
    "a key near one of the validity": ("input_range", "input_rang"),
    "a key given twice": added("chain: {}"),
    "a key of an element given twice": ("delay: 0.0047", "delay: 0.0047, delay: 1.0"),
    "an element near one": ("  lag: {", "  lagg: {"),
    "no gain": without("  gain: 4.0e-07"),
    "no rate of creep": ("rate_per_decade: 0.012, ", ""),
    "no model": without("  model: prandtl-ishlinskii"),
    "a model near one": ("model: prandtl-ishlinskii", "model: prandtl-ishlinski"),
    "a model near none": ("model: prandtl-ishlinskii", "model: coulomb"),
    "a number as model": ("model: prandtl-ishlinskii", "model: 7"),
    "a list as model": ("model: prandtl-ishlinskii", "model: [dahl]"),
    "another model": ("model: prandtl-ishlinskii", "model: dahl"),
    "a text for a number": ("delay: 0.0047", "delay: soon"),
    "a number in quotes": ("delay: 0.0047", "delay: '0.0047'"),
    "a number with a unit": ("delay: 0.0047", "delay: 4.7 ms"),
    "nothing for a number": ("delay: 0.0047", "delay: null"),
    "true for a number": ("delay: 0.0047", "delay: true"),
    "a list for a number": ("delay: 0.0047", "delay: [0.0047]"),
    "a mapping for a number": ("delay: 0.0047", "delay: {value: 0.0047}"),
    "a negative delay": ("delay: 0.0047", "delay: -0.1"),
    "a delay that is not a number": ("delay: 0.0047", "delay: .nan"),
    "a delay that is not finite": ("delay: 0.0047", "delay: .inf"),
    "a delay of ages": ("delay: 0.0047", "delay: 1e300"),
    "a number beyond 64 bits": ("delay: 0.0047", f"delay: {'9' * 59}"),
    "2.5 lags in a decade": ("per_decade: 2}", "per_decade: 2.5}"),
    "2.0 lags in a decade": ("per_decade: 2}", "per_decade: 2.0}"),
    "no lags in a decade": ("per_decade: 2}", "per_decade: 0}"),
    "a negative rate of creep": ("rate_per_decade: 0.012", "rate_per_decade: -0.012"),
    "a gain that is not a number": ("gain: 4.0e-07", "gain: .nan"),
    "a gain that is not finite": ("gain: 4.0e-07", "gain: .inf"),
    "a whole number as gain": ("gain: 4.0e-07", "gain: 1"),
    "thresholds that fall": ("[2.0, 9.0]", "[9.0, 2.0]"),
    "a threshold of zero": ("[2.0, 9.0]", "[0.0, 9.0]"),
    "a text among thresholds": ("[2.0, 9.0]", "[2.0, high]"),
    "thresholds that are not finite": ("[2.0, 9.0]", "[2.0, .inf]"),
    "a number for thresholds": ("[2.0, 9.0]", "2.0"),
    "no thresholds": ("[2.0, 9.0]", "[]"),
    "thresholds in rows": ("[2.0, 9.0]", "[[2.0], [9.0]]"),
    "thresholds in rows of two lengths": ("[2.0, 9.0]", "[[2.0], [9.0, 3.0]]"),
    "more thresholds than weights": ("[2.0, 9.0]", "[2.0, 9.0, 11.0]"),
    "more frequencies than dampings": ("[320.9]", "[320.9, 411.0]"),
    "a negative frequency": ("[320.9]", "[-320.9]"),
    "a negative damping": ("[0.011]", "[-0.011]"),
    "an offset that is a text": ("offset: -3.1e-06", "offset: low"),
    "an offset that is not finite": ("offset: -3.1e-06", "offset: .inf"),
    "an offset that is a list": ("offset: -3.1e-06", "offset: [1]"),
    "no offset": ("offset: -3.1e-06, ", ""),
    "a sign of 0.5": ("sign: 1.0", "sign: 0.5"),
    "a sign that is a text": ("sign: 1.0", "sign: plus"),
    "a key near one of the output": ("sign: 1.0", "sgn: 1.0"),
    "a unit as a list": ("{unit: V}", "{unit: [V]}"),
    "a unit as a number": ("{unit: V}", "{unit: 7}"),
    "a unit that is none": ("{unit: V}", "{unit: Vv}"),
    "a unit of another dimension": ("{unit: V}", "{unit: kg}"),
    "no unit": ("{unit: V}", "{}"),
    "a text for a section": ("input: {unit: V}", "input: V"),
    "a text for an element": ("lag: {time_constant: 0.0, delay: 0.0047}", "lag: soon"),
    "a list for an element": ("lag: {time_constant: 0.0, delay: 0.0047}", "lag: [1.0]"),
    "a start that is none": ("start: rested", "start: resting"),
    "a negative start": ("start: rested", "start: -3"),
    "a start as a list": ("start: rested", "start: [rested]"),
    "a range of one": ("[0.0, 117.0]", "[0.0]"),
    "a range that falls": ("[0.0, 117.0]", "[117.0, 0.0]"),
    "a range that is not finite": ("[0.0, 117.0]", "[0.0, .inf]"),
    "a range of texts": ("[0.0, 117.0]", "[low, high]"),
    "a number for a range": ("[0.0, 117.0]", "117.0"),
    "a text for the validity": (
        TEXT[TEXT.index("\nvalidity:") : TEXT.index("\nerrors")],
        "\nvalidity: wide",
    ),
    "a text for the warnings": ("warnings: []", "warnings: 5"),
    "a list among the warnings": ("warnings: []", "warnings: [[1]]"),
    "a number for the errors": ("errors_percent_of_stroke: {}", "errors_percent_of_stroke: 3"),
    "a number for the provenance": (TEXT[TEXT.index("provenance:") :], "provenance: 7\n"),
    "a number that was changed": ("offset: -3.1e-06", "offset: -3.2e-06"),
    "no checksum": (TEXT[TEXT.index("checksum:") :], ""),
    "a number as checksum": (TEXT[TEXT.index("checksum:") :], "checksum: 7\n"),
}
