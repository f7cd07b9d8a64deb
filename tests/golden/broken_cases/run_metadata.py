"""What a recording says of its run, and how it is broken."""

import json

from tests.golden.broken_cases.ways import Edits, changed, lacking

TEXT = json.dumps(
    {
        "stage": "vgtu-piezo",
        "instrument": {"vendor": "Physik", "model": "E-7xx", "simulated": True},
        "settings": {"servo x": "on", "P": "0.03"},
        "kind": "motion",
        "axis": "x",
        "note": "after lunch",
        "seed": 7,
        "version": "1.0",
        "started": "2031-05-17T09:30:00+00:00",
        "identifier": "0f" * 16,
    },
    indent=1,
)

EDITS: Edits = {
    "a key near a known one": ('"note"', '"notes"'),
    "a key near one that must be": ('"stage"', '"stag"'),
    "a key near one of the instrument": ('"vendor"', '"vendr"'),
    "a key given twice": ('"kind": "motion"', '"kind": "motion", "kind": "hold"'),
    "no stage": lacking(TEXT, "stage"),
    "no instrument": lacking(TEXT, "instrument"),
    "no seed": lacking(TEXT, "seed"),
    "an instrument without a model": ('"model": "E-7xx",', ""),
    "a text as instrument": changed(TEXT, instrument="E-7xx"),
    "a list as instrument": changed(TEXT, instrument=["E-7xx"]),
    "nothing as instrument": changed(TEXT, instrument=None),
    "a number as vendor": changed(TEXT, instrument={"vendor": 7, "model": "m"}),
    "a text for simulated": changed(
        TEXT, instrument={"vendor": "v", "model": "m", "simulated": "no"}
    ),
    "a number as stage": changed(TEXT, stage=7),
    "nothing as stage": changed(TEXT, stage=None),
    "a list as note": changed(TEXT, note=["after", "lunch"]),
    "a number as version": changed(TEXT, version=1.0),
    "another version": changed(TEXT, version="99.0"),
    "a list as settings": changed(TEXT, settings=["on"]),
    "a text as settings": changed(TEXT, settings="on"),
    "nothing as settings": changed(TEXT, settings=None),
    "a number among the settings": changed(TEXT, settings={"P": 0.03}),
    "seed 1.5": changed(TEXT, seed=1.5),
    "seed 1e3": ('"seed": 7', '"seed": 1e3'),
    "seed as a text": changed(TEXT, seed="7"),
    "seed true": changed(TEXT, seed=True),
    "seed not a number": ('"seed": 7', '"seed": NaN'),
    "a negative seed": changed(TEXT, seed=-7),
    "a seed of 5000 digits": ('"seed": 7', f'"seed": {"7" * 5000}'),
    "a short identifier": changed(TEXT, identifier="0f"),
    "an identifier in capitals": changed(TEXT, identifier="0F" * 16),
    "a number as identifier": changed(TEXT, identifier=7),
    "an empty identifier": changed(TEXT, identifier=""),
    "a start that is no time": changed(TEXT, started="yesterday"),
    "a start without a zone": changed(TEXT, started="2031-05-17T09:30:00"),
    "a start in month 13": changed(TEXT, started="2031-13-17T09:30:00+00:00"),
    "a number as start": changed(TEXT, started=7),
    "an empty start": changed(TEXT, started=""),
}
