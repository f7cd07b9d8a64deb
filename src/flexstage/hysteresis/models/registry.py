# ruff: noqa: F401
"""The hysteresis models, one line each, and their code in C and MATLAB.

Whatever takes a model by its name finds it here. The folder of a model is called like it. It holds
``law.py`` with the class that the line names and with what C and MATLAB take of it (`c_code`,
`matlab_code`), ``fit.py`` with the class of that name and ``Fit`` after it, the header for C, the
function of MATLAB, and test vectors. One from elsewhere is added by ``MODELS[Law.kind] = Law``; all
that there is of it stands in the module of the law.
"""

import sys
from collections.abc import Iterator, MutableMapping
from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING

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
    """Return a module of the folder of a model: ``law`` or ``fit``."""
    own = MODELS._classes[kind]
    if not isinstance(own, str):
        return sys.modules[own.__module__]
    return import_module(f"flexstage.hysteresis.models.{kind.replace('-', '_')}.{name}")


def _written(model: HysteresisModel, name: str) -> bool:
    return model.kind in MODELS and hasattr(part(model.kind, "law"), name)


def hysteresis_code(model: HysteresisModel) -> HysteresisCode:
    """Return what C needs to compute a hysteresis model from volts to metres.

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
    if not _written(model, "c_code"):
        raise ModelError(
            f"there is no C for hysteresis of the kind '{model.kind}': take one of "
            f"{', '.join(MODELS)}"
        )
    code: HysteresisCode = part(model.kind, "law").c_code(model)
    return code


def matlab_code(model: HysteresisModel) -> MatlabCode:
    """Return what MATLAB needs to compute a hysteresis model."""
    if not _written(model, "matlab_code"):
        raise ModelError(
            f"a {model.kind} model is not written for Simulink: identify the record with one of "
            f"{', '.join(sorted(MODELS))}"
        )
    code: MatlabCode = part(model.kind, "law").matlab_code(model)
    return code
