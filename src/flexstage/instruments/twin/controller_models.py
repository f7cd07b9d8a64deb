"""Controllers that the simulated one can answer as: what they call themselves, what they know.

Clients choose their own driver by the model in ``*IDN?``, and by what ``HLP?`` lists. What is known
here of a model is what drivers that others wrote say of it, and else what its kind is: digital
piezo controllers, stepping drives, analogue amplifiers. No list of commands of its maker was used.
"""

from dataclasses import dataclass

#: Commands of controllers with reference or limit switches; of stepping drives.
_REFERENCE = frozenset({"FNL", "FPL", "FRF", "LIM?", "RON", "RON?"})
_ENABLE = frozenset({"EAX", "EAX?"})
_STATUS = frozenset({"SRG?", "TRS?"})
#: Commands of analogue amplifiers with a digital interface.
_ANALOGUE = frozenset({"DCO", "DCO?", "NLM", "ONL", "ONL?", "PLM", "VCO", "VCO?", "VMA", "VMI"})
#: Commands of digital controllers only.
_DIGITAL = frozenset(
    {"AOS?", "ATZ", "ATZ?", "CTO", "CTO?", "IDN?", "IFC?", "OVF?", "SSN?", "TAD?", "TNS?", "TWC",
     "TWS", "TWS?", "WOS", "WOS?"}
)  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class ControllerModel:
    """A type of controller."""

    name: str
    """As ``*IDN?`` tells it; none for the simulation's own."""
    lacks: frozenset[str] = frozenset()
    """Commands that it answers with error 2."""
    syntax: str = "2.0"
    """Version of the command set, as ``CSV?`` tells it."""
    unit: str = "um"
    """Unit of positions, as it is written."""
    inputs: int | None = None
    """How many inputs it lists where none is named; all of them where not given."""

    @property
    def one_line(self) -> bool:
        """Whether the axes are listed in one line, as before version 2 of the command set."""
        return self.syntax.startswith("1")


#: Answers as itself, and knows all commands.
OWN = ControllerModel(name="")

_DIGITAL_PIEZO = _REFERENCE | _ENABLE | _ANALOGUE
_AMPLIFIER = _REFERENCE | _ENABLE | _STATUS | _DIGITAL

#: The models by name, the usual one first.
MODELS = {
    model.name: model
    for model in (
        ControllerModel(name="E-727", lacks=_DIGITAL_PIEZO | _STATUS | {"FRF?"}),
        ControllerModel(name="E-709", lacks=_DIGITAL_PIEZO),
        ControllerModel(name="E-712", lacks=_ANALOGUE),
        ControllerModel(name="E-725", lacks=_DIGITAL_PIEZO),
        ControllerModel(name="E-753", lacks=_DIGITAL_PIEZO | {"HLT"}, unit="\xb5M", inputs=2),
        ControllerModel(name="E-754", lacks=_DIGITAL_PIEZO, inputs=3),
        ControllerModel(name="E-516", lacks=_AMPLIFIER, syntax="1.0"),
        ControllerModel(name="E-517", lacks=_AMPLIFIER),
    )
}
