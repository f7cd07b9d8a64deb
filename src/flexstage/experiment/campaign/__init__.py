"""A set of tests: their description, and the figures that their records give."""

from typing import TYPE_CHECKING

from flexstage.lazy import import_on_use

if TYPE_CHECKING:
    from flexstage.experiment.campaign.evaluate import EVALUATIONS, characterise, evaluate
    from flexstage.experiment.campaign.file import campaign_text, read_campaign
    from flexstage.experiment.campaign.plan import (
        KINDS,
        Campaign,
        Columns,
        Instrument,
        Reading,
        Test,
    )
    from flexstage.experiment.campaign.results import Characterisation, Figure, TestResult

__all__ = [
    "EVALUATIONS",
    "KINDS",
    "Campaign",
    "Characterisation",
    "Columns",
    "Figure",
    "Instrument",
    "Reading",
    "Test",
    "TestResult",
    "campaign_text",
    "characterise",
    "evaluate",
    "read_campaign",
]

import_on_use(__name__)
