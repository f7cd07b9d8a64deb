"""The command line that does what the view Explore does."""

import shlex
from dataclasses import fields
from typing import Any

from flexstage.designs import StageTemplate
from flexstage.explore.requests.optimise import OptimiseRequest
from flexstage.explore.requests.sensitivity import SensitivityRequest
from flexstage.explore.requests.sweep import SweepRequest
from flexstage.explore.requests.tolerance import ToleranceRequest
from flexstage.units import readable_text

Request = SweepRequest | OptimiseRequest | ToleranceRequest | SensitivityRequest

_COMMANDS: dict[type, str] = {
    SweepRequest: "sweep",
    OptimiseRequest: "optimise",
    ToleranceRequest: "tolerance",
    SensitivityRequest: "sensitivity",
}


def command_line(template: StageTemplate, request: Request) -> str:
    """Return the command line of a request about a stage, as a shell takes it.

    Examples
    --------
    >>> guide = StageTemplate.of("parallelogram")
    >>> command_line(guide, SweepRequest(over=("leg_spacing=30 %",), model="superelement"))
    "flexstage sweep parallelogram --over 'leg_spacing=30 %' --model superelement"
    """
    words = ["flexstage", _COMMANDS[type(request)], template.source]
    for name, text in template.settings:
        words += ["--set", f"{name}={text}"]
    for field in fields(request):
        value = getattr(request, field.name)
        if value != field.default:
            words += _option(field.name, value)
    return shlex.join(words)


def _option(name: str, value: Any) -> list[str]:
    if name == "step":
        return ["--per", readable_text(value, "length")]
    option = f"--{name.replace('_', '-')}"
    if value is True:
        return [option]
    values = value if isinstance(value, tuple) else (value,)
    return [word for each in values for word in (option, str(each))]
