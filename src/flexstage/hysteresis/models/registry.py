# ruff: noqa: F401
"""The hysteresis models, one line each: whatever takes a model by its name finds it here.

The folder of a model is called like it. It holds ``law.py`` with the class that the line names,
``fit.py`` with the class of that name and ``Fit`` after it, ``code.py`` with `c_code` and
`matlab_code`, the header for C, the function of MATLAB, and test vectors. One from elsewhere is
added by ``MODELS[Law.kind] = Law``; all that there is of it stands in the module of the law.
"""

import sys
from collections.abc import Iterator, MutableMapping
from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING

from flexstage.hysteresis.model import HysteresisModel
from flexstage.lazy import names_for_types

if TYPE_CHECKING:
    from flexstage.hysteresis.models.asymmetric_bouc_wen.law import AsymmetricBoucWen
    from flexstage.hysteresis.models.bouc_wen.law import BoucWen
    from flexstage.hysteresis.models.dahl.law import Dahl
    from flexstage.hysteresis.models.duhem.law import Duhem
    from flexstage.hysteresis.models.generalised_bouc_wen.law import GeneralisedBoucWen
    from flexstage.hysteresis.models.maxwell_slip.law import GeneralisedMaxwellSlip
    from flexstage.hysteresis.models.modified_prandtl_ishlinskii.law import (
        ModifiedPrandtlIshlinskii,
    )
    from flexstage.hysteresis.models.prandtl_ishlinskii.law import PrandtlIshlinskii
    from flexstage.hysteresis.models.preisach.law import Preisach


class _Models(MutableMapping[str, type[HysteresisModel]]):
    """Classes by the names of the models, each imported when it is asked for."""

    def __init__(self) -> None:
        self._classes: dict[str, str | type[HysteresisModel]] = {
            home.split(".")[-2].replace("_", "-"): name
            for home, name in names_for_types(__name__).values()
        }

    def __getitem__(self, kind: str) -> type[HysteresisModel]:
        law = self._classes[kind]
        return getattr(part(kind, "law"), law) if isinstance(law, str) else law

    def __setitem__(self, kind: str, law: type[HysteresisModel]) -> None:
        self._classes[kind] = law

    def __delitem__(self, kind: str) -> None:
        del self._classes[kind]

    def __iter__(self) -> Iterator[str]:
        return iter(self._classes)

    def __len__(self) -> int:
        return len(self._classes)


#: Every hysteresis model, by its name in files and on the command line.
MODELS = _Models()


def part(kind: str, name: str) -> ModuleType:
    """Return a module of the folder of a model: ``law``, ``fit`` or ``code``."""
    own = MODELS._classes[kind]
    if not isinstance(own, str):
        return sys.modules[own.__module__]
    return import_module(f"flexstage.hysteresis.models.{kind.replace('-', '_')}.{name}")
