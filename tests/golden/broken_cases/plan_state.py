"""How far a plan has come, and how that is broken."""

import json

from tests.golden.broken_cases.ways import Edits, changed, lacking

TEXT = json.dumps(
    {
        "run": 1,
        "plan": "chapter 3",
        "stage": "vgtu-piezo",
        "stage_hash": "ab12",
        "instrument": {"vendor": "Physik", "model": "E-7xx"},
        "operator": "Ona",
        "steps": {
            "loops": {
                "status": "complete",
                "fingerprint": "cd34",
                "files": {"loops.csv": "ef56"},
                "partial": ["loops.partial-1.h5"],
                "started": "2031-05-17T09:30:00+00:00",
            }
        },
    },
    indent=1,
)

EDITS: Edits = {
    "a key near a known one": ('"operator"', '"operatr"'),
    "a key near none": changed(TEXT, zebra=1),
    "a key near one of a step": ('"files"', '"file"'),
    "a key given twice": ('"plan": "chapter 3"', '"plan": "chapter 3", "plan": "chapter 4"'),
    "no version": lacking(TEXT, "run"),
    "a version to come": changed(TEXT, run=2),
    "the version as a text": changed(TEXT, run="1"),
    "the version as true": changed(TEXT, run=True),
    "version 1.0": changed(TEXT, run=1.0),
    "no steps": lacking(TEXT, "steps"),
    "no plan": lacking(TEXT, "plan"),
    "a list as steps": changed(TEXT, steps=["loops"]),
    "nothing as steps": changed(TEXT, steps=None),
    "a text as step": changed(TEXT, steps={"loops": "complete"}),
    "nothing as step": changed(TEXT, steps={"loops": None}),
    "a step without a status": ('"status": "complete",', ""),
    "a step without a fingerprint": ('"fingerprint": "cd34",', ""),
    "a step without its partial files": (
        ',\n   "partial": [\n    "loops.partial-1.h5"\n   ]',
        "",
    ),
    "a status that is none": ('"complete"', '"finished"'),
    "a number as status": ('"complete"', "7"),
    "nothing as status": ('"complete"', "null"),
    "a number as fingerprint": ('"cd34"', "34"),
    "a list as files": ('{\n    "loops.csv": "ef56"\n   }', '["loops.csv"]'),
    "a number as checksum of a file": ('"ef56"', "56"),
    "a text as partial files": ('[\n    "loops.partial-1.h5"\n   ]', '"loops.partial-1.h5"'),
    "a number among partial files": ('"loops.partial-1.h5"', "7"),
    "a number as partial files": ('[\n    "loops.partial-1.h5"\n   ]', "7"),
    "a number as plan": changed(TEXT, plan=3),
    "nothing as stage": changed(TEXT, stage=None),
    "a list as operator": changed(TEXT, operator=["Ona"]),
    "a text as instrument": changed(TEXT, instrument="Physik"),
    "a start that is no time": ('"2031-05-17T09:30:00+00:00"', '"yesterday"'),
    "a number that is none": ('"cd34"', "NaN"),
}
