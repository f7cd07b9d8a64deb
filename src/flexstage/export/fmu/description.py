"""The file `modelDescription.xml` of an FMU, for FMI 2.0 and FMI 3.0."""

import re
from xml.etree import ElementTree as ET

from flexstage.export.fmu.layout import FmuLayout, FmuVariable
from flexstage.hysteresis.dynamic_model import DynamicModel

#: Main source file by version; it includes all others.
MAIN = {"2.0": "fmi2.c", "3.0": "fmi3.c"}

_STEPS_SHOWN = 10000  # of the default experiment: a second of most stages


def tool() -> str:
    """Return the name of this program with its version."""
    from flexstage.base.version import __version__

    return f"flexstage {__version__}"


def model_description(model: DynamicModel, layout: FmuLayout, version: str, token: str) -> bytes:
    """Return the model description; the token is the guid or instantiation token."""
    second = version == "2.0"
    root = ET.Element(
        "fmiModelDescription",
        {
            "fmiVersion": version,
            "modelName": model.name,
            ("guid" if second else "instantiationToken"): token,
            "description": model.title or model.name,
            "author": "",
            "license": "generated code, free to use, see documentation/licenses",
            "generationTool": tool(),
            "variableNamingConvention": "structured",
        },
    )
    if second:
        root.set("numberOfEventIndicators", str(layout.count["indicator"]))
    _interfaces(root, model, layout, second)
    _units(root, layout)
    categories = ET.SubElement(root, "LogCategories")
    for name, what in (
        ("logStatusDiscard", "a step was refused; the state did not change"),
        ("logStatusError", "a call failed"),
    ):
        ET.SubElement(categories, "Category", name=name, description=what)
    step = f"{model.step!r}"
    ET.SubElement(
        root, "DefaultExperiment", startTime="0.0",
        stopTime=repr(float(f"{_STEPS_SHOWN * model.step:.6g}")), tolerance="1e-6", stepSize=step,
    )  # fmt: skip
    variables = ET.SubElement(root, "ModelVariables")
    for v in layout.variables:
        _variable(variables, v, second)
    _structure(root, model, layout, second)
    ET.indent(root, "  ")
    title = (model.title or model.name).replace("--", "-").strip("-")
    note = ET.Comment(f" {title}. Written by {tool()}. ")
    body = ET.tostring(root, encoding="unicode")
    head = '<?xml version="1.0" encoding="UTF-8"?>\n' + ET.tostring(note, encoding="unicode")
    return f"{head}\n{body}\n".encode()


def _interfaces(root: ET.Element, model: DynamicModel, layout: FmuLayout, second: bool) -> None:
    letter = "s" if second else "S"
    common = {
        "modelIdentifier": layout.identifier,
        "needsExecutionTool": "false",
        "canBeInstantiatedOnlyOncePerProcess": "false",
        f"canGetAndSetFMU{letter}tate": "true",
        f"canSerializeFMU{letter}tate": "true",
        ("providesDirectionalDerivative" if second else "providesDirectionalDerivatives"): "false",
    }
    exchange = ET.SubElement(root, "ModelExchange", common)
    simulation = ET.SubElement(root, "CoSimulation", common)
    simulation.set("canHandleVariableCommunicationStepSize", "true")
    if second:
        exchange.set("completedIntegratorStepNotNeeded", "false")
        simulation.set("canInterpolateInputs", "true")
        simulation.set("maxOutputDerivativeOrder", "0")
        for element in (exchange, simulation):
            element.set("canNotUseMemoryManagementFunctions", "true")
            ET.SubElement(ET.SubElement(element, "SourceFiles"), "File", name=MAIN["2.0"])
    else:
        exchange.set("needsCompletedIntegratorStep", "true")
        exchange.set("providesEvaluateDiscreteStates", "true")
        simulation.set("fixedInternalStepSize", repr(model.step))
        simulation.set("hasEventMode", "false")


def _units(root: ET.Element, layout: FmuLayout) -> None:
    definitions = ET.SubElement(root, "UnitDefinitions")
    for unit in dict.fromkeys(v.unit for v in layout.variables if not v.integer):
        element = ET.SubElement(definitions, "Unit", name=unit)
        exponents = base_units(unit)
        if exponents is not None:
            ET.SubElement(element, "BaseUnit", {k: f"{n:g}" for k, n in exponents.items()})


def _numbers(v: FmuVariable) -> dict[str, str]:
    """Return the attributes of a number; their order is not significant in XML."""
    attributes: dict[str, str] = {}
    if not v.integer:
        attributes["unit"] = v.unit
    if v.limits is not None:
        low, high = (repr(int(x) if v.integer else float(x)) for x in v.limits)
        attributes |= {"min": low, "max": high}
    if v.nominal is not None:
        attributes["nominal"] = f"{v.nominal:.6g}"
    if v.start is not None:
        attributes["start"] = repr(int(v.start) if v.integer else float(v.start))
    return attributes


def _variable(parent: ET.Element, v: FmuVariable, second: bool) -> None:
    tag = "ScalarVariable" if second else "Int32" if v.integer else "Float64"
    element = ET.SubElement(
        parent,
        tag,
        name=v.name,
        valueReference=str(v.reference),
        description=v.description,
        causality=v.causality,
        variability=v.variability,
    )
    if v.causality in ("output", "local"):
        element.set("initial", "calculated")
    elif v.causality == "parameter":
        element.set("initial", "exact")
    numbers = _numbers(v)
    if v.state is not None:
        # counted from 1 in version 2.0
        numbers["derivative"] = str(v.state + second)
    if second:
        ET.SubElement(element, "Integer" if v.integer else "Real", numbers)
    else:
        element.attrib.update(numbers)


def _structure(root: ET.Element, model: DynamicModel, layout: FmuLayout, second: bool) -> None:
    structure = ET.SubElement(root, "ModelStructure")
    dependencies = depends_on(model, layout)
    outputs, derivatives = layout.of("output"), layout.of("derivative")
    at_first = sorted(v.reference for v in (*outputs, *layout.of("state"), *derivatives))
    if second:
        for name, unknowns in (("Outputs", outputs), ("Derivatives", derivatives)):
            listed = ET.SubElement(structure, name)
            for v in unknowns:
                needs = " ".join(str(r + 1) for r in dependencies[v.reference])
                ET.SubElement(listed, "Unknown", index=str(v.reference + 1), dependencies=needs)
        listed = ET.SubElement(structure, "InitialUnknowns")
        for reference in at_first:
            ET.SubElement(listed, "Unknown", index=str(reference + 1))
        return
    for name, unknowns in (("Output", outputs), ("ContinuousStateDerivative", derivatives)):
        for v in unknowns:
            needs = " ".join(map(str, dependencies[v.reference]))
            ET.SubElement(structure, name, valueReference=str(v.reference), dependencies=needs)
    for reference in at_first:
        ET.SubElement(structure, "InitialUnknown", valueReference=str(reference))
    for v in layout.of("indicator"):
        needs = " ".join(map(str, dependencies[v.reference]))
        about = {"valueReference": str(v.reference), "dependencies": needs}
        ET.SubElement(structure, "EventIndicator", about)


def depends_on(model: DynamicModel, layout: FmuLayout) -> dict[int, list[int]]:
    """Return the inputs and states on which outputs, derivatives and event indicators depend.

    All are value references in rising order, where 0 is time.
    """
    k, x, at = model.omega.size, layout.first["state"], layout.states
    dx = layout.first["derivative"]
    q, v = x + at.deflection_at, x + at.deflection_at + k
    to_rate = dx - x
    drives = range(len(model.drives))
    # inputs of the free displacement of a drive, without and with its creep
    source = [
        [layout.first["input"] + d if at.voltage_at[d] < 0 else x + at.voltage_at[d]]
        for d in drives
    ]
    lags = [
        [x + at.lag_at[d] + j for j in range(model.drives[d].lag_weights.shape[1])] for d in drives
    ]
    total = [source[d] + lags[d] for d in drives]
    dependencies: dict[int, list[int]] = {}
    for d in drives:
        if at.voltage_at[d] >= 0:
            command = layout.first["input"] + d
            dependencies[dx + at.voltage_at[d]] = [command, *source[d]]
        for lag in lags[d]:
            dependencies[lag + to_rate] = [*source[d], lag]
    for m in range(k):
        force_inputs = [t for d in drives if model.drives[d].modal_gain[m] != 0.0 for t in total[d]]
        rate_inputs = [t for d in drives if model.drives[d].rate_time[m] != 0.0 for t in total[d]]
        dependencies[q + m + to_rate] = [v + m, *rate_inputs]
        dependencies[v + m + to_rate] = [q + m, v + m, *force_inputs]
    for p, probe in enumerate(model.probes):
        motion = [q + m for m in range(k) if model.probe_shapes[p, m] != 0.0]
        motion += [t for d in drives if model.drives[d].feedthrough[p] != 0.0 for t in total[d]]
        reading = layout.first["output"] + p
        dependencies[reading] = motion
        if at.seen_at[p] >= 0:
            sensor_state = x + at.seen_at[p]
            dependencies[sensor_state + to_rate] = [*motion, sensor_state]
            # a bandwidth of 0 removes the lag
            dependencies[reading] = [*motion, sensor_state]
        if probe.sensor is not None:
            dependencies[reading] = [0, *dependencies[reading]]
    amplified = [d for d in drives if at.voltage_at[d] >= 0]
    each = layout.count["indicator"] // max(len(amplified), 1)
    for j, d in enumerate(amplified):
        for event in range(each):
            reference = layout.first["indicator"] + each * j + event
            dependencies[reference] = [layout.first["input"] + d, *source[d]]
    return {key: sorted(set(value)) for key, value in dependencies.items()}


_BASES = ("kg", "m", "s", "A", "K", "mol", "cd", "rad")


# exponents of kg, m, s, A; then K and rad where they are not 0
_KNOWN: dict[str, dict[str, int]] = {
    "1": {},
    "V": {"kg": 1, "m": 2, "s": -3, "A": -1},
    "N": {"kg": 1, "m": 1, "s": -2},
    "Hz": {"s": -1},
    "F": {"kg": -1, "m": -2, "s": 4, "A": 2},
    "Pa": {"kg": 1, "m": -1, "s": -2},
    "J": {"kg": 1, "m": 2, "s": -2},
    **{base: {base: 1} for base in _BASES},
}


_PREFIXES = {"n": 1e-9, "u": 1e-6, "µ": 1e-6, "μ": 1e-6, "m": 1e-3, "k": 1e3, "M": 1e6}


_FACTOR = re.compile(r"(?P<unit>[A-Za-zµμ]+|1)\^?(?P<power>-?[0-9.]+)?")


def base_units(unit: str) -> dict[str, float] | None:
    """Return the nonzero exponents of kg, m, s, A, K, mol, cd, rad in a unit.

    A unit has powers, spaces and one ``/``: ``m/V^2``, ``1/(V m)``. A prefix adds ``factor`` if it
    is not 1. None for a unit without such integer exponents.

    Examples
    --------
    >>> base_units("m/V"), base_units("Hz"), base_units("um")
    ({'kg': -1, 'm': -1, 's': 3, 'A': 1}, {'s': -1}, {'m': 1, 'factor': 1e-06})
    >>> base_units("1/(V m^0.5)") is None
    True
    """
    above, _, below = unit.partition("/")
    total: dict[str, float] = {}
    factor = 1.0
    for text, sign in ((above, 1), (below, -1)):
        for part in text.strip().strip("()").replace("*", " ").replace(".", " .").split():
            factor_match = _FACTOR.fullmatch(part)
            if factor_match is None:
                return None
            power = sign * float(factor_match["power"] or 1.0)
            exponents, scale = _exponents(factor_match["unit"])
            if exponents is None or power != int(power):
                return None
            factor *= scale**power
            for base, value in exponents.items():
                total[base] = total.get(base, 0) + int(power) * value
    out: dict[str, float] = {base: total[base] for base in _BASES if total.get(base)}
    return out if factor == 1.0 else {**out, "factor": factor}


def _exponents(unit: str) -> tuple[dict[str, int] | None, float]:
    if unit in _KNOWN:
        return _KNOWN[unit], 1.0
    if unit[:1] in _PREFIXES and unit[1:] in _KNOWN and unit[1:] not in ("1", "kg"):
        return _KNOWN[unit[1:]], _PREFIXES[unit[0]]
    return None, 1.0
