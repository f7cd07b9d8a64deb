"""Units of the parameters of hysteresis models, from those of input and output."""

from collections.abc import Mapping

_SLOPE = "{y}/{u}"
#: Units that parameters have in most models, ...
_COMMON: Mapping[str, str] = {
    "anhysteretic": "{y}, {y}/{u}, {y}/{u}^2, {y}/{u}^3",
    "beta": "1/{u}",
    "centre": "{u}",
    "creep_per_decade": "1",
    "cubic": "{y}/{u}^3",
    "dead_zone_weights": "1",
    "dead_zones": "{y}",
    "delay": "s",
    "exponent": "1",
    "gain": _SLOPE,
    "gamma": "1/{u}",
    "highest_input": "{u}",
    "hysteresis_gain": _SLOPE,
    "input_range": "{u}",
    "knots": "{u}",
    "limit": "{y}",
    "lowest_input": "{u}",
    "quadratic": "{y}/{u}^2",
    "rate": "1/{u}",
    "resonance_hz": "Hz",
    "shape": "1/{u}",
    "slopes": _SLOPE,
    "stiffness": _SLOPE,
    "tangent": "{y}/{u}, {y}/{u}^2",
    "thresholds": "{u}",
    "weights": _SLOPE,
}
#: ... and in the one that goes from output to input.
_BACKWARD: Mapping[str, str] = {
    "dead_zone_weights": "{u}/{y}",
    "element_stiffness": "{u}/{y}",
    "stiffness": "{u}/{y}",
    "thresholds": "{y}",
}


def parameter_unit(kind: str, name: str, input_unit: str, output_unit: str) -> str:
    """Return the unit of a parameter.

    Of a kind that has an exponent it is that for 1. A name may be an element, such as
    ``weights[3]``; units that nobody has said are called input and output.

    Examples
    --------
    >>> parameter_unit("bouc-wen", "gain", "V", "m")
    'm/V'
    """
    table = {**_COMMON, **_BACKWARD} if kind == "maxwell-slip" else _COMMON
    template = table.get(name.split("[", maxsplit=1)[0], "1")
    return template.format(u=input_unit or "input", y=output_unit or "output")
