"""A hysteresis model as C: which header computes it, and with which parameters."""

from collections.abc import Callable, Mapping
from typing import Any

from flexstage.errors import ModelError
from flexstage.export.source.hysteresis_code_laws import (
    asymmetric_bouc_wen_code,
    bouc_wen_code,
    dahl_code,
    duhem_code,
    generalised_bouc_wen_code,
)
from flexstage.export.source.hysteresis_code_parts import HysteresisCode
from flexstage.export.source.hysteresis_code_plays import (
    maxwell_slip_code,
    modified_prandtl_ishlinskii_code,
    prandtl_ishlinskii_code,
    preisach_code,
)
from flexstage.hysteresis.model import HysteresisModel

_CODES: Mapping[str, Callable[[Any], HysteresisCode]] = {
    "bouc-wen": bouc_wen_code,
    "asymmetric-bouc-wen": asymmetric_bouc_wen_code,
    "generalised-bouc-wen": generalised_bouc_wen_code,
    "dahl": dahl_code,
    "duhem": duhem_code,
    "prandtl-ishlinskii": prandtl_ishlinskii_code,
    "modified-prandtl-ishlinskii": modified_prandtl_ishlinskii_code,
    "maxwell-slip": maxwell_slip_code,
    "preisach": preisach_code,
}


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
    if model.kind not in _CODES:
        raise ModelError(
            f"there is no C for hysteresis of the kind '{model.kind}': take one of "
            f"{', '.join(_CODES)}"
        )
    return _CODES[model.kind](model)
