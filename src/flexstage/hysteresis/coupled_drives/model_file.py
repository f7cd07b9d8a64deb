"""The file that holds an identified model of coupled drives: readable text, checked when read."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from flexstage.base.arrays import Array, Complex
from flexstage.base.errors import ModelError
from flexstage.files.decoder import Decoder, read_file
from flexstage.files.format import Form, Format
from flexstage.files.nodes import Node
from flexstage.files.plain import plain
from flexstage.hysteresis.coupled_drives.identify import CoupledDriveIdentification
from flexstage.hysteresis.coupled_drives.model import CoupledDriveModel
from flexstage.hysteresis.model_file import MODEL_FILE, yaml_text


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Content:
    model: CoupledDriveModel
    errors: tuple[float, ...] = ()
    """Error at each level, rms in the unit of the outputs."""
    warnings: tuple[str, ...] = ()


def _read_complex(decoder: Decoder, node: Node, path: str, _default: Any) -> Complex:
    entry = decoder.mapping(node, path)
    parts = {
        name: MODEL_FILE.forms[Array].read(decoder, entry.items[name], f"{path}.{name}", None)
        for name in ("real", "imaginary")
        if name in entry.items
    }
    if len(parts) != 2 or parts["real"].shape != parts["imaginary"].shape:
        decoder.refuse(node, path, "expected 'real' and 'imaginary' parts of one shape")
    return parts["real"] + 1j * parts["imaginary"]


#: The kind of file that holds a model of coupled drives.
COUPLED_MODEL_FILE = Format(
    noun="model of coupled drives from `flexstage identify --out`",
    key="flexstage-coupled-drives",
    error=ModelError,
    only=True,
    forms={**MODEL_FILE.forms, Complex: Form(read=_read_complex)},
)


def coupled_model_text(result: CoupledDriveIdentification) -> str:
    """Return the model of an identification as YAML, which `read_coupled_model` reads."""
    content = _Content(
        model=result.model,
        errors=tuple(level.error for level in result.levels),
        warnings=result.warnings,
    )
    return description_text(COUPLED_MODEL_FILE, content)


def description_text(kind: Format, content: Any) -> str:
    """Return a description as the YAML of a kind of file."""
    return yaml_text({kind.key: kind.version, **plain(content)})


def is_coupled_model(path: Path) -> bool:
    """Return whether a file begins as a model of coupled drives; a missing one does not."""
    return begins_as(path, COUPLED_MODEL_FILE)


def begins_as(path: Path, kind: Format) -> bool:
    """Return whether a file begins as one of a kind."""
    try:
        with path.open(encoding="utf-8", errors="replace") as file:
            return file.readline().startswith(kind.key)
    except OSError:
        return False


def read_coupled_model(path: Path) -> CoupledDriveModel:
    """Read a model of coupled drives; a ModelError where the file is none."""
    decoder, root = read_file(path, COUPLED_MODEL_FILE)
    content: _Content = decoder.build(_Content, root, "")
    model = content.model
    shapes = (model.drives.input_shapes.shape, model.system.feedthrough.shape)
    expected = (
        (model.drives.compliance.size, len(model.inputs)),
        (len(model.outputs), len(model.inputs)),
    )
    if shapes != expected:
        raise ModelError(
            f"{path}: arrays of shapes {shapes} do not fit inputs and outputs, {expected}"
        )
    return model
