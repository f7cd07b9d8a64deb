"""The file `modelDescription.xml` of an FMU, of FMI 2.0 and of FMI 3.0."""

from xml.etree import ElementTree as ET

from flexstage.export.fmu.dependencies import depends_on
from flexstage.export.fmu.layout import FmuLayout, FmuVariable
from flexstage.export.fmu.unit_definitions import base_units
from flexstage.export.model import DynamicModel

#: The file to compile, by version; it includes all others.
MAIN = {"2.0": "fmi2.c", "3.0": "fmi3.c"}

_KINDS = ("state", "derivative")
_STEPS_SHOWN = 10000  # of the default experiment: a second of most stages


def tool() -> str:
    """Return the name of this program with its version."""
    from flexstage import __version__

    return f"flexstage {__version__}"


def model_description(model: DynamicModel, layout: FmuLayout, version: str, token: str) -> bytes:
    """Return what an FMU says about itself; the token is the guid or instantiation token."""
    second = version == "2.0"
    root = ET.Element(
        "fmiModelDescription",
        {
            "fmiVersion": version,
            "modelName": model.name,
            ("guid" if second else "instantiationToken"): token,
            "description": model.title or model.name,
            "author": "",
            "license": "generated code: use it freely, see documentation/licenses",
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
        ("logStatusDiscard", "a step that was refused; nothing has moved"),
        ("logStatusError", "a call that could not be done"),
    ):
        ET.SubElement(categories, "Category", name=name, description=what)
    step = f"{model.step!r}"
    ET.SubElement(
        root, "DefaultExperiment", startTime="0.0",
        stopTime=repr(float(f"{_STEPS_SHOWN * model.step:.6g}")), tolerance="1e-6", stepSize=step,
    )  # fmt: skip
    variables = ET.SubElement(root, "ModelVariables")
    for v in layout.variables:
        (_scalar_variable if second else _variable)(variables, v)
    _structure(root, model, layout, second)
    ET.indent(root, "  ")
    note = ET.Comment(f" {_plain(model.title or model.name)}. Written by {tool()}. ")
    body = ET.tostring(root, encoding="unicode")
    head = '<?xml version="1.0" encoding="UTF-8"?>\n' + ET.tostring(note, encoding="unicode")
    return f"{head}\n{body}\n".encode()


def _plain(text: str) -> str:
    return text.replace("--", "-").strip("-")


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
    for unit in dict.fromkeys(v.unit for v in layout.variables if not v.whole):
        element = ET.SubElement(definitions, "Unit", name=unit)
        exponents = base_units(unit)
        if exponents is not None:
            ET.SubElement(element, "BaseUnit", {k: f"{n:g}" for k, n in exponents.items()})


def _numbers(v: FmuVariable) -> dict[str, str]:
    """Attributes of a number, in the order of the schema of neither: XML has none."""
    made: dict[str, str] = {}
    if not v.whole:
        made["unit"] = v.unit
    if v.limits is not None:
        low, high = (repr(int(x) if v.whole else float(x)) for x in v.limits)
        made |= {"min": low, "max": high}
    if v.nominal is not None:
        made["nominal"] = f"{v.nominal:.6g}"
    if v.start is not None:
        made["start"] = repr(int(v.start) if v.whole else float(v.start))
    return made


def _scalar_variable(parent: ET.Element, v: FmuVariable) -> None:
    element = ET.SubElement(
        parent,
        "ScalarVariable",
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
    made = _numbers(v)
    if v.state is not None:
        # variables are counted from 1 there
        made["derivative"] = str(v.state + 1)
    ET.SubElement(element, "Integer" if v.whole else "Real", made)


def _variable(parent: ET.Element, v: FmuVariable) -> None:
    element = ET.SubElement(
        parent,
        "Int32" if v.whole else "Float64",
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
    for key, value in _numbers(v).items():
        element.set(key, value)
    if v.state is not None:
        element.set("derivative", str(v.state))


def _structure(root: ET.Element, model: DynamicModel, layout: FmuLayout, second: bool) -> None:
    structure = ET.SubElement(root, "ModelStructure")
    known = depends_on(model, layout)
    outputs, derivatives = layout.of("output"), layout.of("derivative")
    at_first = sorted(v.reference for v in (*outputs, *layout.of("state"), *derivatives))
    if second:
        for name, unknowns in (("Outputs", outputs), ("Derivatives", derivatives)):
            listed = ET.SubElement(structure, name)
            for v in unknowns:
                needs = " ".join(str(r + 1) for r in known[v.reference])
                ET.SubElement(listed, "Unknown", index=str(v.reference + 1), dependencies=needs)
        listed = ET.SubElement(structure, "InitialUnknowns")
        for reference in at_first:
            ET.SubElement(listed, "Unknown", index=str(reference + 1))
        return
    for name, unknowns in (("Output", outputs), ("ContinuousStateDerivative", derivatives)):
        for v in unknowns:
            needs = " ".join(map(str, known[v.reference]))
            ET.SubElement(structure, name, valueReference=str(v.reference), dependencies=needs)
    for reference in at_first:
        ET.SubElement(structure, "InitialUnknown", valueReference=str(reference))
    for v in layout.of("indicator"):
        needs = " ".join(map(str, known[v.reference]))
        about = {"valueReference": str(v.reference), "dependencies": needs}
        ET.SubElement(structure, "EventIndicator", about)
