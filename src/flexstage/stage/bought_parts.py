"""Drives and sensors as they are bought, which files name with the key ``as``."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Annotated

from flexstage.base.errors import StageError
from flexstage.files.decoder import Decoder, read_file
from flexstage.files.format import Format
from flexstage.files.nodes import Mapping as MappingNode
from flexstage.files.ranges import POSITIVE
from flexstage.quantities.sensor import SensorSpecification
from flexstage.quantities.units import DIMENSIONS
from flexstage.stage.drive import AnyActuator

_PATH = Path(__file__).with_name("bought_parts.yaml")
_FILE = Format(noun="catalogue of bought parts", key="bought_parts", error=StageError)


@dataclass(frozen=True, slots=True, kw_only=True)
class BoughtDrive:
    """An actuator as its maker prints it."""

    maker: str
    """Maker."""
    source: str
    """Where its figures are printed."""
    free_resonance: Annotated[float, DIMENSIONS["frequency"], POSITIVE] | None = None
    """Lowest resonance of the free actuator [Hz]."""
    drive: AnyActuator
    """The actuator."""


@dataclass(frozen=True, slots=True, kw_only=True)
class BoughtSensor:
    """A sensor as its maker prints it."""

    maker: str
    """Maker."""
    source: str
    """Where its figures are printed."""
    principle: str
    """Its principle, such as capacitive."""
    note: str = ""
    """Printed figures that an uncertainty budget does not use."""
    sensor: SensorSpecification
    """The sensor."""


@dataclass(frozen=True, slots=True, kw_only=True)
class BoughtParts:
    """The catalogue of bought parts."""

    drives: Mapping[str, BoughtDrive] = field(default_factory=dict)
    """Actuators by their designation."""
    sensors: Mapping[str, BoughtSensor] = field(default_factory=dict)
    """Sensors by their designation."""


@cache
def _read() -> tuple[Decoder, MappingNode]:
    return read_file(_PATH, _FILE)


@cache
def bought_parts() -> BoughtParts:
    """Return the catalogue of bought parts.

    Examples
    --------
    >>> bought_parts().drives["SA050520"].drive.blocking_force
    900.0
    """
    decoder, root = _read()
    return decoder.build(BoughtParts, root, "")


def bought_drives() -> dict[str, MappingNode]:
    """Return the keys of each drive of the catalogue, as a file has them."""
    return _keys("drives", "drive")


def bought_sensors() -> dict[str, MappingNode]:
    """Return the keys of each sensor of the catalogue, as a file has them."""
    return _keys("sensors", "sensor")


def _keys(group: str, key: str) -> dict[str, MappingNode]:
    decoder, root = _read()
    parts = decoder.mapping(root.items[group], group).items
    return {
        name: decoder.mapping(decoder.mapping(part, name).items[key], name)
        for name, part in parts.items()
    }
