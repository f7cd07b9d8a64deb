# ruff: noqa: F401
"""Registry of the hysteresis models, one line each, and their code in C and MATLAB.

Models are found by name here. The folder of a model has its name. It contains ``law.py`` with the
class named here and its code (`c_code`, `matlab_code`), the header for C and the function for
MATLAB where no other model shares them, and test vectors. ``fits.py`` has the class of that name
and ``Fit`` after it. Add a model from elsewhere by ``MODELS[Law.kind] = Law``; all its parts are in
the module of the law.
"""

import sys
from collections.abc import Iterator, MutableMapping
from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING, Any

from flexstage.base.errors import ModelError
from flexstage.base.lazy import names_for_types
from flexstage.hysteresis.model import HysteresisModel
from flexstage.hysteresis.models.source_code import HysteresisCode, MatlabCode

if TYPE_CHECKING:
    from flexstage.hysteresis.models.asymmetric_bouc_wen.law import AsymmetricBoucWen
    from flexstage.hysteresis.models.bouc_wen.law import BoucWen
    from flexstage.hysteresis.models.dahl.law import Dahl
    from flexstage.hysteresis.models.duhem.law import Duhem
    from flexstage.hysteresis.models.generalised_bouc_wen.law import GeneralisedBoucWen
    from flexstage.hysteresis.models.line.law import Line
    from flexstage.hysteresis.models.maxwell_slip.law import GeneralisedMaxwellSlip
    from flexstage.hysteresis.models.modified_prandtl_ishlinskii.law import (
        ModifiedPrandtlIshlinskii,
    )
    from flexstage.hysteresis.models.prandtl_ishlinskii.law import PrandtlIshlinskii
    from flexstage.hysteresis.models.preisach.law import Preisach


class _Models(MutableMapping[str, type[HysteresisModel]]):
    """Classes by names of the models, imported on first use."""

    def __init__(self) -> None:
        self._classes: dict[str, str | type[HysteresisModel]] = {
            home.split(".")[-2].replace("_", "-"): name
            for home, name in names_for_types(__name__).values()
        }

    def __getitem__(self, kind: str) -> type[HysteresisModel]:
        law = self._classes[kind]
        return getattr(_law_module(kind), law) if isinstance(law, str) else law

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


def _law_module(kind: str) -> ModuleType:
    law = MODELS._classes[kind]
    if not isinstance(law, str):
        return sys.modules[law.__module__]
    return import_module(f"flexstage.hysteresis.models.{kind.replace('-', '_')}.law")


def fit_class(kind: str) -> Any:
    """Return the class that fits a model, named after its law, or None."""
    law = MODELS._classes[kind]
    ours = isinstance(law, str)
    home = import_module("flexstage.hysteresis.models.fits") if ours else _law_module(kind)
    return getattr(home, f"{law if ours else law.__name__}Fit", None)


def _has_code(model: HysteresisModel, name: str) -> bool:
    return model.kind in MODELS and hasattr(_law_module(model.kind), name)


def hysteresis_code(model: HysteresisModel) -> HysteresisCode:
    """Return the code in C of a hysteresis model from volts to metres.

    Notes
    -----
    Validity: in double precision, without contraction of products and sums, the C functions do the
    operations of the model in their order. Results are the same bits where both take exponentials
    and logarithms from one mathematical library; elsewhere they differ by its rounding. In single
    precision they are within 1e-6 of the stroke (Duhem 2e-6) where the voltage moves by turns.
    Very slow motion one way, 10 uV a step, costs models that keep a displacement as memory
    (Bouc-Wen, Dahl) 1e-4 of the stroke over 3 V, and Duhem 7e-3; sums of plays lose nothing.
    Exponents above 6 do not fit into single precision for lengths in metres.

    Examples
    --------
    >>> from flexstage.hysteresis import BoucWen
    >>> stack = BoucWen(gain=0.593e-6, hysteresis_gain=0.441e-6, beta=0.05, gamma=0.03)
    >>> code = hysteresis_code(stack)
    >>> code.header, code.function, code.memory, code.pieces
    ('hysteresis_bouc_wen.h', 'fs_bouc_wen', 2, 2)
    >>> [f"{p.name} [{p.unit}] = p[{p.index}]" for p in code.tunable][:2]
    ['gain [m/V] = p[0]', 'hysteresis_gain [m/V] = p[1]']
    """
    if not _has_code(model, "c_code"):
        raise ModelError(
            f"there is no C code for hysteresis of the kind '{model.kind}': use one of "
            f"{', '.join(MODELS)}"
        )
    code: HysteresisCode = _law_module(model.kind).c_code(model)
    return code


def matlab_code(model: HysteresisModel) -> MatlabCode:
    """Return the code in MATLAB of a hysteresis model."""
    if not _has_code(model, "matlab_code"):
        raise ModelError(
            f"there is no Simulink code for the model '{model.kind}': identify the record with "
            f"one of {', '.join(sorted(MODELS))}"
        )
    code: MatlabCode = _law_module(model.kind).matlab_code(model)
    return code
