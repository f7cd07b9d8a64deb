"""The file that describes a set of tests."""

import os
from pathlib import Path
from typing import Any

from flexstage.errors import StageError
from flexstage.experiment.campaign.plan import Campaign
from flexstage.stage.decoder import Decoder
from flexstage.stage.encoder import Number, encode
from flexstage.stage.yaml_reader import Mapping as MappingNode
from flexstage.stage.yaml_reader import Scalar, parse_yaml, read_text
from flexstage.stage.yaml_writer import yaml_text

_VERSION = 1


def read_campaign(path: str | os.PathLike[str]) -> Campaign:
    """Read the description of tests from a YAML file whose first key is ``campaign: 1``.

    Records are still named as in the file; a mistake is named by its line.
    """
    file = Path(path)
    source = os.fspath(path)
    kind = "description of tests"
    root = parse_yaml(read_text(file, kind), source, kind)
    decoder = Decoder(source)
    if not isinstance(root, MappingNode) or "campaign" not in root.items:
        decoder.refuse(root, "", "a description of tests begins with 'campaign: 1'")
    version: Any = decoder.decode(float, root.items["campaign"], "campaign")
    if version != _VERSION:
        decoder.refuse(
            root.items["campaign"],
            "campaign",
            f"version {version:g} is not known: this flexstage reads version {_VERSION}",
            StageError,
        )
    rest = MappingNode(
        root.line, {k: v for k, v in root.items.items() if k != "campaign"}, root.key_lines
    )
    _check_instruments(decoder, rest)
    return decoder.build(Campaign, rest, "")


def _check_instruments(decoder: Decoder, root: MappingNode) -> None:
    """Refuse an instrument that is not described where a test names it."""
    listed = root.items.get("instruments")
    known = list(listed.items) if isinstance(listed, MappingNode) else []
    entries = root.items.get("tests")
    if not isinstance(entries, MappingNode) or not isinstance(listed, (MappingNode, type(None))):
        return  # the decoder says what is wrong with that
    for name, test in entries.items.items():
        for role in ("along", "transverse", "angle"):
            node = test.items.get(role) if isinstance(test, MappingNode) else None
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
    data = {"campaign": Number(_VERSION), **encode(Campaign, campaign, None)}
    return yaml_text(data)
