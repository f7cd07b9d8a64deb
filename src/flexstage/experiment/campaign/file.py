"""The file that describes a set of tests."""

import os
from pathlib import Path

from flexstage.errors import StageError
from flexstage.experiment.campaign.plan import Campaign
from flexstage.files.decoder import Decoder, read_file
from flexstage.files.encoder import Encoder
from flexstage.files.format import Format
from flexstage.files.nodes import Mapping, Scalar

#: The kind of file that describes tests.
CAMPAIGN_FILE = Format(
    noun="description of tests",
    key="campaign",
    error=StageError,
)


def read_campaign(path: str | os.PathLike[str]) -> Campaign:
    """Read the description of tests from a YAML file whose first key is ``campaign: 1``.

    Records are still named as in the file; a mistake is named by its line.
    """
    decoder, root = read_file(Path(path), CAMPAIGN_FILE)
    _check_instruments(decoder, root)
    return decoder.build(Campaign, root, "")


def _check_instruments(decoder: Decoder, root: Mapping) -> None:
    """Refuse an instrument that is not described where a test names it."""
    listed = root.items.get("instruments")
    known = list(listed.items) if isinstance(listed, Mapping) else []
    entries = root.items.get("tests")
    if not isinstance(entries, Mapping) or not isinstance(listed, (Mapping, type(None))):
        return  # the decoder says what is wrong with that
    for name, test in entries.items.items():
        for role in ("along", "transverse", "angle"):
            node = test.items.get(role) if isinstance(test, Mapping) else None
            if isinstance(node, Scalar) and node.value is not None and node.text not in known:
                decoder.refuse(
                    node,
                    f"tests.{name}.{role}",
                    f"the instrument '{node.text[:60]}' is not described (there are: "
                    f"{', '.join(known) or 'none'}): list it under 'instruments'",
                )


def campaign_text(campaign: Campaign) -> str:
    """Write the description of tests as the text of its file.

    `read_campaign` reads it back; what is as usual is left out.
    """
    return Encoder(CAMPAIGN_FILE).text(campaign)
