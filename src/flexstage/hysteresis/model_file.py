"""Model file of an identified drive: readable text, checked on reading."""

import hashlib
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np

from flexstage.base.arrays import Array
from flexstage.base.choose import did_you_mean
from flexstage.base.errors import ModelError
from flexstage.files import nodes
from flexstage.files.decoder import Decoder, read, read_file, show
from flexstage.files.encoder import plain_dumper
from flexstage.files.format import Form, Format
from flexstage.files.nodes import Node, Scalar
from flexstage.hysteresis.chain.creep import Creep, CreepSpectrum, LogCreep, Start
from flexstage.hysteresis.chain.lag import Lag
from flexstage.hysteresis.chain.stage_modes import StageModes
from flexstage.hysteresis.drive_model import DriveModel, ValidityRange
from flexstage.hysteresis.model import HysteresisModel
from flexstage.hysteresis.models.registry import MODELS
from flexstage.hysteresis.requests import Zero

_CHANGED = "the file was changed since it was written"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ModelFile:
    """Drive model with its provenance."""

    model: DriveModel
    """The model."""
    provenance: Mapping[str, Any] = field(default_factory=dict)
    """Software, time, records and settings of its identification."""
    errors: Mapping[str, float | None] = field(default_factory=dict)
    """Errors over the stroke, on fitted and held-out samples [%]."""
    warnings: tuple[str, ...] = ()
    """Warnings of its identification."""

    @property
    def notes(self) -> tuple[str, ...]:
        """Warnings for users of the model, with their origin."""
        return tuple(
            w if w == _CHANGED else f"from the identification of the model: {w}"
            for w in self.warnings
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class _Input:
    unit: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Output:
    unit: str = ""
    offset: float = 0.0
    sign: float = 1.0
    zero: Zero = "one"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Chain:
    """Elements behind the hysteresis; all are in the file, so that a missing one is noticed."""

    creep: Creep | None
    modes: StageModes | None
    lag: Lag | None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Content:
    """Content of the file between its version and its checksum, in this order."""

    input: _Input
    output: _Output
    hysteresis: HysteresisModel
    chain: _Chain
    start: Start = "rested"
    validity: ValidityRange | None = None
    errors_percent_of_stroke: Mapping[str, float | None] | None = None
    warnings: tuple[str, ...] | None = None
    provenance: Mapping[str, Any] | None = None


def model_text(file: ModelFile) -> str:
    """Return a drive model as YAML, from which `read_model_text` reads the same numbers."""
    m = file.model
    content = _Content(
        input=_Input(unit=m.input_unit),
        output=_Output(unit=m.output_unit, offset=float(m.offset), sign=float(m.sign), zero=m.zero),
        hysteresis=m.hysteresis,
        chain=_Chain(creep=m.creep, modes=m.modes, lag=m.lag),
        start=m.start,
        validity=m.validity,
        errors_percent_of_stroke=file.errors,
        warnings=file.warnings,
        provenance=file.provenance,
    )
    data = {MODEL_FILE.key: MODEL_FILE.version, **_plain(content)}
    return yaml_text({**data, "checksum": _checksum(data)})


def yaml_text(data: Mapping[str, Any]) -> str:
    """Return plain data as the text of a model file."""
    import yaml

    return yaml.dump(
        data,
        Dumper=plain_dumper(),
        sort_keys=False,
        allow_unicode=True,
        width=100,
        default_flow_style=None,
    )


def read_model_file(path: Path) -> ModelFile:
    """Read the file of a drive model; a ModelError if it does not exist or is no model."""
    return _model_file(*read_file(path, MODEL_FILE))


def read_model_text(text: str, source: str = "the model file") -> ModelFile:
    """Read a drive model from the text of its file, which messages call `source`.

    A number that was changed by hand is allowed, with a warning. A ModelError if it is no model
    file, of a newer version, or its numbers are invalid.
    """
    return _model_file(*read(text, source, MODEL_FILE))


def _model_file(decoder: Decoder, root: nodes.Mapping) -> ModelFile:
    content: _Content = decoder.build(_Content, root, "", also=["checksum"])
    sign, offset = content.output.sign, content.output.offset
    if sign not in (1.0, -1.0) or not math.isfinite(offset):
        message = f"expected a sign of 1 or -1 and a finite offset, got {sign:g} and {offset:g}"
        decoder.refuse(root.items["output"], "output", message)
    data = {MODEL_FILE.key: MODEL_FILE.version, **nodes.plain(root)}
    was_changed = data.pop("checksum", None) != _checksum(data)
    return ModelFile(
        model=DriveModel(
            hysteresis=content.hysteresis,
            creep=content.chain.creep,
            modes=content.chain.modes,
            lag=content.chain.lag,
            offset=offset,
            sign=sign,
            input_unit=content.input.unit,
            output_unit=content.output.unit,
            validity=content.validity,
            start=content.start,
            zero=content.output.zero,
        ),
        provenance=content.provenance or {},
        errors=content.errors_percent_of_stroke or {},
        warnings=(*(content.warnings or ()), *([_CHANGED] if was_changed else [])),
    )


def _read_hysteresis(decoder: Decoder, node: Node, path: str, _base: Any) -> HysteresisModel:
    entry = decoder.mapping(node, path)
    kind = decoder.member(MODELS, entry, path, "model")
    return decoder.build(kind, entry, path, also=["model"])


def _read_creep(decoder: Decoder, node: Node, path: str, _base: Any) -> Creep:
    entry = decoder.mapping(node, path)
    kind = CreepSpectrum if {"times", "weights"} & entry.items.keys() else LogCreep
    return decoder.build(kind, entry, path)


def _read_start(decoder: Decoder, node: Node, path: str, _base: Any) -> Start:
    value = node.value if isinstance(node, Scalar) else None
    if value == "rested":
        return value
    if not isinstance(value, (int, float)) or isinstance(value, bool) or not value >= 0.0:
        hint = did_you_mean(value, ["rested"]) if isinstance(value, str) else ""
        message = f"expected rested, or seconds of motion, got {show(node)}{hint}"
        decoder.refuse(node, path, message)
    return float(value)


def _read_range(decoder: Decoder, node: Node, path: str, _base: Any) -> tuple[float, float]:
    items = decoder.items(node, path, 2, "two finite, rising numbers")
    low, high = (decoder.number(item, f"{path}[{k}]") for k, item in enumerate(items))
    if not -math.inf < low <= high < math.inf:
        message = f"expected two finite, rising numbers, got {low:g} and {high:g}"
        decoder.refuse(node, path, message)
    return low, high


def _read_array(decoder: Decoder, node: Node, path: str, _base: Any) -> Array:
    def rows(node: Node, path: str) -> Any:
        if isinstance(node, Scalar):
            return decoder.number(node, path)
        items = decoder.items(node, path, None, "numbers")
        return [rows(item, f"{path}[{k}]") for k, item in enumerate(items)]

    decoder.items(node, path, None, "numbers")
    numbers = rows(node, path)
    try:
        return np.array(numbers, dtype=np.float64)
    except ValueError:
        decoder.refuse(node, path, "expected numbers in rows of one length")


def _read_sequence(decoder: Decoder, node: Node, path: str, _base: Any) -> tuple[float, ...]:
    return decoder.decode(tuple[float, ...], node, path)


def _read_text(decoder: Decoder, node: Node, path: str, _base: Any) -> str:
    text = decoder.text(node, path)
    if text != nodes.plain(node):
        decoder.refuse(node, path, f"expected a text, got {text}: write it in quotes")
    return text


#: File format of an identified drive. The time of motion before a record may be infinite.
MODEL_FILE = Format(
    noun="model file from `flexstage identify --out`",
    key="flexstage-drive-model",
    error=ModelError,
    only=True,
    finite=False,
    forms={
        HysteresisModel: Form(read=_read_hysteresis),
        Creep: Form(read=_read_creep),
        Start: Form(read=_read_start),
        tuple[float, float]: Form(read=_read_range),
        Sequence[float]: Form(read=_read_sequence),
        Array: Form(read=_read_array),
        str: Form(read=_read_text),
    },
)


def _plain(value: Any) -> Any:
    """Return descriptions and arrays as plain data."""
    if isinstance(value, HysteresisModel):
        return {"model": value.kind, **_plain(value.parameters())}
    if is_dataclass(value):
        return {f.name: _plain(getattr(value, f.name)) for f in fields(value)}
    if isinstance(value, Mapping):
        return {k: _plain(v) for k, v in value.items()}
    if isinstance(value, (tuple, list)):
        return [_plain(v) for v in value]
    return value.tolist() if isinstance(value, (np.ndarray, np.generic)) else value


def _checksum(content: Mapping[str, Any]) -> str:
    """Hash of the numbers, independent of their spelling."""
    return hashlib.sha256(repr(_sorted(content)).encode()).hexdigest()


def _sorted(value: Any) -> Any:
    if isinstance(value, Mapping):
        return sorted((str(k), _sorted(v)) for k, v in value.items())
    if isinstance(value, (list, tuple)):
        return [_sorted(v) for v in value]
    return value
