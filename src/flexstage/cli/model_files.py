"""Files of identified drives, as options and arguments name them."""

from pathlib import Path
from typing import TYPE_CHECKING

from flexstage.errors import ModelError

if TYPE_CHECKING:
    from flexstage.hysteresis import ModelFile

__all__ = ["read_model_file"]

_LARGEST = 20_000_000  # bytes; a model file has some thousands


def read_model_file(path: Path) -> "ModelFile":
    """Read the file of an identified drive.

    Parameters
    ----------
    path : pathlib.Path
        The file.

    Returns
    -------
    ModelFile
        The model and where it comes from.

    Raises
    ------
    ModelError
        There is no such file, or it is no model.
    """
    from flexstage.hysteresis.model_file import read_model_text

    return read_model_text(_text(path), f"'{path}'")


def _text(path: Path) -> str:
    try:
        with path.open("rb") as file:
            content = file.read(_LARGEST + 1)
        if len(content) > _LARGEST:
            raise ModelError(f"'{path}' is no drive model: it is too large for one")
        return content.decode()
    except UnicodeDecodeError as error:
        raise ModelError(f"'{path}' is no drive model: it is not text") from error
    except IsADirectoryError as error:
        raise ModelError(f"'{path}' is a directory: name the model file in it") from error
    except FileNotFoundError as error:
        raise ModelError(
            f"there is no model file '{path}': `flexstage identify --out` writes one"
        ) from error
