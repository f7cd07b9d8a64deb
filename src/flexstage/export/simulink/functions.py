"""Functions of MATLAB that a Simulink model holds, one for each hysteresis."""

from collections.abc import Mapping

from flexstage.export.simulink.hysteresis_text import hysteresis_function
from flexstage.export.simulink.matlab_text import identifier
from flexstage.hysteresis import HysteresisModel


class Functions:
    """Texts by the names of their functions, which begin with a prefix.

    A model that comes again keeps its name.
    """

    __slots__ = ("_models", "_prefix", "_texts")

    def __init__(self, prefix: str) -> None:
        self._prefix = prefix
        self._texts: dict[str, str] = {}
        self._models: list[tuple[HysteresisModel, str]] = []

    def add(self, model: HysteresisModel, wanted: str) -> str:
        """Return the name of the function of a model that belongs to what is wanted."""
        for known, name in self._models:
            if known is model:
                return name
        suffix = identifier(wanted.removesuffix("_hysteresis"), longest=63)
        room = 63 - len(self._prefix) - 3
        base = name = f"{self._prefix}{suffix[:room]}"
        count = 1
        while name.lower() in {taken.lower() for taken in self._texts}:
            count += 1
            name = f"{base}_{count}"
        self._texts[name] = hysteresis_function(model, name)
        self._models.append((model, name))
        return name

    @property
    def texts(self) -> Mapping[str, str]:
        """Texts by name."""
        return dict(self._texts)
