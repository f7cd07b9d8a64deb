"""The files for MATLAB and Octave."""

import re
from functools import cache
from importlib import resources

import flexstage
from flexstage.errors import ModelError
from flexstage.export.build_model import dynamic_model
from flexstage.export.matlab.contents import contents
from flexstage.export.model import DynamicModel
from flexstage.export.simulink.matlab_text import KEYWORDS
from flexstage.export.simulink.variables import mat_file
from flexstage.stage import Stage
from flexstage.system import MechanicalSystem

_TEMPLATES = ("stage_script.m", "stage_step.m")
_LONGEST = 63 - len("_step")  # of a name in MATLAB


def matlab_files(
    stage: Stage,
    system: MechanicalSystem,
    *,
    model: DynamicModel | None = None,
    name: str | None = None,
) -> dict[str, bytes]:
    """Return a stage for MATLAB and Octave.

    ``NAME.mat`` (level 5) holds the matrices in first-order form, continuous and from sample to
    sample, mass, damping and stiffness, modes, and the drives with hysteresis, amplifier and creep;
    ``NAME.m`` loads it, makes state spaces where the control toolbox is, draws Bode diagrams and
    runs the stage in time; ``NAME_step.m`` is one exact step of the whole model.

    Where a dynamic model is given, its mechanical system is taken; else it has the usual
    hysteresis. NAME, a name in MATLAB, comes from the stage where not given.

    Notes
    -----
    Validity: ``NAME_step.m`` steps linear drives and Bouc-Wen hysteresis of exponent 1, with modes
    of a damping ratio below 1; of other hysteresis the file holds the parameters alone.

    Examples
    --------
    >>> from flexstage.designs import design
    >>> from flexstage.lumped import lumped_system
    >>> stage = design("vgtu-piezo")
    >>> list(matlab_files(stage, lumped_system(stage)))
    ['vgtu_piezo.mat', 'vgtu_piezo.m', 'vgtu_piezo_step.m']
    """
    made = dynamic_model(stage, system) if model is None else model
    if not made.probes:
        raise ModelError(f"stage '{made.name}' has no probe: there is nothing to read from it")
    called = matlab_name(made.name) if name is None else name
    if not re.fullmatch(rf"[A-Za-z]\w{{0,{_LONGEST - 1}}}", called, re.ASCII):
        raise ModelError(
            f"'{called}' is no name in MATLAB: begin with a letter, then letters, digits and _, "
            f"{_LONGEST} in all"
        )
    return {
        f"{called}.mat": mat_file(contents(stage, made)),
        f"{called}.m": _text(_TEMPLATES[0], called, made.title),
        f"{called}_step.m": _text(_TEMPLATES[1], called, made.title),
    }


def matlab_name(text: str) -> str:
    """Return the nearest name that MATLAB and C allow, at most 58 letters, digits, underscores.

    It is no word of the language, and no function or variable that the files use.

    Examples
    --------
    >>> matlab_name("2-axis stage"), matlab_name("sin")
    ('stage_2_axis_stage', 'stage_sin')
    """
    made = re.sub(r"\W+", "_", text, flags=re.ASCII).strip("_")
    # a script called as a function that is used, or as a word of the language, would hide it
    if not made or not made[0].isalpha() or made.lower() in _used_words():
        made = f"stage_{made}".rstrip("_")
    return made[:_LONGEST]


@cache
def _used_words() -> frozenset[str]:
    words: set[str] = set(KEYWORDS)
    for file in _TEMPLATES:
        code = re.sub(r"^ *%.*", "", _template(file), flags=re.MULTILINE)
        words |= set(re.findall(r"[A-Za-z]\w*", code, re.ASCII))
    return frozenset(word.lower() for word in words)


def _template(file: str) -> str:
    return resources.files("flexstage.export.matlab").joinpath(file).read_text(encoding="utf-8")


def _text(file: str, name: str, title: str) -> bytes:
    raw = _template(file)
    # MATLAB on some systems reads files in its own encoding: nothing but ASCII there
    plain = " ".join(title.split()).encode("ascii", "replace").decode("ascii")
    for token, value in (
        ("STAGE_NAME", name),
        ("STAGE_TITLE", plain),
        ("FLEXSTAGE_VERSION", flexstage.__version__),
    ):
        raw = raw.replace(token, value)
    return raw.encode("ascii")
