"""The file that holds an identified drive: readable text, checked when it is read."""

import dataclasses
import hashlib
import inspect
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from flexstage.errors import FlexstageError, ModelError
from flexstage.files.nodes import parse_yaml, plain, read_text
from flexstage.files.yaml_text import plain_dumper
from flexstage.hysteresis.chain.creep import CreepSpectrum, LogCreep
from flexstage.hysteresis.chain.lag import Lag
from flexstage.hysteresis.chain.stage_modes import StageModes
from flexstage.hysteresis.drive_model import DriveModel, ValidityRange
from flexstage.hysteresis.model import HysteresisModel
from flexstage.hysteresis.models import MODELS

#: Version of the format. A reader takes this one and none that is newer.
_VERSION = 1
_KEY = "flexstage-drive-model"
_ELEMENTS: Mapping[str, type[Any]] = {"creep": LogCreep, "modes": StageModes, "lag": Lag}
#: What such a file is called in messages.
_KIND = "model file, as `flexstage identify --out` writes one"

_CHANGED = "the file was changed since it was written"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ModelFile:
    """A drive model with where it comes from."""

    model: DriveModel
    """The model."""
    provenance: Mapping[str, Any] = field(default_factory=dict)
    """Software, time, records and settings that it was identified with."""
    errors: Mapping[str, float | None] = field(default_factory=dict)
    """Errors over the stroke, where it was fitted and where it was not [%]."""
    warnings: tuple[str, ...] = ()
    """What the records could not tell."""

    @property
    def notes(self) -> tuple[str, ...]:
        """What a user of the model should know; what its identification said is named so."""
        return tuple(
            w if w == _CHANGED else f"from the identification of the model: {w}"
            for w in self.warnings
        )


def model_text(file: ModelFile) -> str:
    """Return a drive model as YAML, which `read_model_text` reads back to the same numbers."""
    import yaml

    m = file.model
    content: dict[str, Any] = {
        _KEY: _VERSION,
        "input": {"unit": m.input_unit},
        "output": {"unit": m.output_unit, "offset": float(m.offset), "sign": float(m.sign)},
        "hysteresis": {"model": m.hysteresis.kind, **_plain(m.hysteresis.parameters())},
        "chain": {
            name: _plain(_fields(element)) if element is not None else None
            for name, element in (("creep", m.creep), ("modes", m.modes), ("lag", m.lag))
        },
        "start": m.start,
        "validity": _plain(_fields(m.validity)) if m.validity is not None else None,
        "errors_percent_of_stroke": _plain(dict(file.errors)),
        "warnings": list(file.warnings),
        "provenance": _plain(dict(file.provenance)),
    }
    content["checksum"] = _checksum(content)
    return yaml.dump(
        content,
        Dumper=plain_dumper(),
        sort_keys=False,
        allow_unicode=True,
        width=100,
        default_flow_style=None,
    )


def read_model_file(path: Path) -> ModelFile:
    """Read the file of a drive model; a ModelError where there is none, or it is no model."""
    return read_model_text(read_text(path, _KIND, ModelError), f"'{path}'")


def read_model_text(text: str, source: str = "the model file") -> ModelFile:
    """Read a drive model from the text of its file, which messages call `source`.

    A number that was changed by hand is allowed, and said in the warnings. A ModelError where it is
    no model file, of a newer version, or its numbers make no model.
    """
    # a start may be infinitely long ago
    content = plain(parse_yaml(text, source, "model file", ModelError, finite=False))
    if not isinstance(content, dict) or _KEY not in content:
        raise ModelError(
            f"{source} is no drive model: expected a file that `flexstage identify --out` wrote, "
            f"with the key '{_KEY}'"
        )
    version = content[_KEY]
    if not isinstance(version, int) or isinstance(version, bool) or not 1 <= version <= _VERSION:
        raise ModelError(
            f"{source} has version {version!r} of the format, this flexstage reads up to "
            f"{_VERSION}: use a newer flexstage"
        )
    try:
        model = _drive_model(content)
    except FlexstageError as error:
        raise ModelError(f"{source}: {error}") from error
    except (TypeError, ValueError, KeyError, OverflowError) as error:
        raise ModelError(f"{source} holds no drive model: {error}") from error
    warnings = _texts(content.get("warnings"), source)
    stated = content.pop("checksum", None)
    if stated != _checksum(content):
        warnings = (*warnings, _CHANGED)
    return ModelFile(
        model=model,
        provenance=_optional_mapping(content, "provenance", source),
        errors=_optional_mapping(content, "errors_percent_of_stroke", source),
        warnings=warnings,
    )


def _texts(given: object, source: str) -> tuple[str, ...]:
    if given is None:
        return ()
    if not isinstance(given, list) or not all(isinstance(w, str) for w in given):
        raise ModelError(f"{source}: the section 'warnings' must be a list of texts")
    return tuple(given)


def _optional_mapping(content: Mapping[str, Any], key: str, source: str) -> Mapping[str, Any]:
    given = content.get(key)
    if given is not None and not isinstance(given, dict):
        raise ModelError(f"{source}: the section '{key}' must hold names and values")
    return given or {}


def _drive_model(content: Mapping[str, Any]) -> DriveModel:
    hysteresis = dict(_mapping(content, "hysteresis"))
    kind = hysteresis.pop("model", None)
    if not isinstance(kind, str) or kind not in MODELS:
        raise ModelError(f"the hysteresis model {kind!r} is not known: one of {', '.join(MODELS)}")
    chain = _mapping(content, "chain")
    built: dict[str, Any] = {}
    for name, element in _ELEMENTS.items():
        given = chain.get(name)
        spectrum = name == "creep" and isinstance(given, dict) and "times" in given
        kind_of = CreepSpectrum if spectrum else element
        built[name] = None if given is None else kind_of(**_arguments(kind_of, given, name))
    out, given = _mapping(content, "output"), content.get("validity")
    validity = None
    if given is not None:
        values = _arguments(ValidityRange, given, "validity")
        validity = ValidityRange(
            input_range=_pair(values["input_range"], "input_range"),
            output_range=_pair(values["output_range"], "output_range"),
            rate_range_hz=_pair(values["rate_range_hz"], "rate_range_hz"),
            temperature=None
            if values.get("temperature") is None
            else _pair(values["temperature"], "temperature"),
        )
    made: HysteresisModel = MODELS[kind](**_arguments(MODELS[kind], hysteresis, "hysteresis"))
    sign, offset = float(out.get("sign", 1.0)), float(out.get("offset", 0.0))
    if sign not in (1.0, -1.0) or not math.isfinite(offset):
        raise ModelError(f"the output needs a sign of 1 or -1 and a finite offset, got {out}")
    start = content.get("start", "rested")
    if start != "rested":
        if not isinstance(start, (int, float)) or isinstance(start, bool) or not start >= 0.0:
            raise ModelError(f"start must be rested, or seconds of motion, got {start!r}")
        start = float(start)
    return DriveModel(
        hysteresis=made,
        **built,
        offset=offset,
        sign=sign,
        input_unit=_unit(_mapping(content, "input"), "input"),
        output_unit=_unit(out, "output"),
        validity=validity,
        start=start,
    )


def _unit(section: Mapping[str, Any], name: str) -> str:
    given = section.get("unit", "")
    if not isinstance(given, str):
        raise ModelError(f"{name}.unit must be a text, got {given!r}")
    return given


def _pair(value: Any, where: str) -> tuple[float, float]:
    numbers = np.asarray(value, dtype=np.float64)
    if numbers.shape != (2,) or not np.all(np.isfinite(numbers)) or numbers[0] > numbers[1]:
        raise ModelError(f"validity.{where} must be two finite, rising numbers, got {value!r}")
    return float(numbers[0]), float(numbers[1])


def _mapping(content: Mapping[str, Any], key: str) -> Mapping[str, Any]:
    given = content.get(key)
    if not isinstance(given, dict):
        raise ModelError(f"the section '{key}' is missing")
    return given


def _arguments(target: type[Any], given: object, where: str) -> dict[str, Any]:
    """Return what a class is built with, after checking names and kinds."""
    if not isinstance(given, dict):
        raise ModelError(f"the section '{where}' must hold names and numbers, got {given!r}")
    known = {f.name for f in dataclasses.fields(target)}
    unknown = sorted(str(k) for k in given if k not in known)
    if unknown:
        raise ModelError(
            f"'{where}' has no {', '.join(unknown)}: it has {', '.join(sorted(known))}"
        )
    needed = [
        p.name
        for p in inspect.signature(target).parameters.values()
        if p.default is inspect.Parameter.empty and p.name not in given
    ]
    if needed:
        raise ModelError(f"'{where}' lacks {', '.join(needed)}")
    return {k: _value(v, f"{where}.{k}") for k, v in given.items()}


def _value(value: Any, where: str) -> Any:
    if value is None or isinstance(value, (bool, str)):
        if value is not None:
            raise ModelError(f"{where} must be a number, got {value!r}")
        return None
    if isinstance(value, (int, float)):
        if abs(value) > 1e300:  # an integer of YAML can be longer than any number
            raise ModelError(f"{where} is too large")
        return value
    try:
        array = np.array(value, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ModelError(f"{where} must be numbers in rows of one length") from error
    return array


def _fields(thing: Any) -> dict[str, Any]:
    return {f.name: getattr(thing, f.name) for f in dataclasses.fields(thing)}


def _plain(values: Mapping[str, Any]) -> dict[str, Any]:
    return {k: _plain_value(v) for k, v in values.items()}


def _plain_value(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, (tuple, list)):
        return [_plain_value(v) for v in value]
    if isinstance(value, Mapping):
        return _plain(value)
    return value


def _checksum(content: Mapping[str, Any]) -> str:
    """Hash of the numbers, however they are spelled."""
    return hashlib.sha256(repr(_sorted(content)).encode()).hexdigest()


def _sorted(value: Any) -> Any:
    if isinstance(value, Mapping):
        return sorted((str(k), _sorted(v)) for k, v in value.items())
    if isinstance(value, (list, tuple)):
        return [_sorted(v) for v in value]
    return value
