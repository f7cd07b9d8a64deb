"""Evaluate the tests of a campaign, one by one."""

import os
from collections.abc import Callable
from pathlib import Path

from flexstage import progress
from flexstage.characteristic import one_of_each
from flexstage.errors import FlexstageError, RecordError
from flexstage.experiments.campaign.kinds import KINDS
from flexstage.experiments.campaign.loading import load_records
from flexstage.experiments.campaign.plan import Campaign, Test
from flexstage.experiments.campaign.results import Characterisation
from flexstage.records import Record


def evaluate(campaign: Campaign, load: Callable[[Test], list[Record]]) -> Characterisation:
    """Evaluate all tests of a campaign.

    `load` gives the records of a test.

    Examples
    --------
    >>> from flexstage.designs import design
    >>> from flexstage.virtual.as_built import as_built
    >>> from flexstage.experiments.virtual_campaign import virtual_campaign
    >>> made = virtual_campaign(as_built(design("vgtu-piezo"), seed=1), seed=1)
    >>> found = evaluate(made.campaign, lambda test: [made.records[n] for n in test.records])
    >>> stroke = found.figure("output_displacement", "x").estimate
    >>> print(f"{stroke.value * 1e6:.1f} um")
    63.1 um
    """
    results = []
    sources: dict[str, str] = {}
    for k, test in enumerate(campaign.tests):
        with progress.subtask(k / len(campaign.tests), (k + 1) / len(campaign.tests)):
            progress.update(f"test {test.name}"[:17])
            try:
                records = load(test)
                results.append(KINDS[test.kind].evaluate(test, records, campaign))
            except FlexstageError as error:
                if f"'{test.name}'" in str(error):
                    raise
                raise type(error)(f"test '{test.name}': {error}") from error
            sources |= {r.source: r.source_hash for r in records if r.source_hash}
    return Characterisation(
        stage=campaign.stage,
        origin=campaign.origin,
        results=tuple(results),
        figures=one_of_each(figure for result in results for figure in result.figures),
        sources=sources,
        notes=campaign.notes,
    )


def characterise(campaign: Campaign, folder: str | os.PathLike[str] = ".") -> Characterisation:
    """Read the files of a campaign, named from a folder, and evaluate its tests.

    What cannot be read or evaluated is named by its test.
    """
    base = Path(folder)
    if not campaign.tests:
        raise RecordError("the campaign has no test: describe one at least")
    return evaluate(campaign, lambda test: load_records(test, base))
