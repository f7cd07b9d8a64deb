"""The files for MATLAB and Octave, and what their .mat file holds."""

import re
from dataclasses import dataclass
from functools import cache
from importlib import resources
from typing import Any

import numpy as np

from flexstage.base.errors import ModelError
from flexstage.base.version import __version__
from flexstage.export.control_object import linear_part, rest_shape, state_names
from flexstage.export.request import StageExport
from flexstage.export.simulink.matlab_text import KEYWORDS, mat_file
from flexstage.hysteresis import Amplifier
from flexstage.hysteresis.build_model import dynamic_model
from flexstage.hysteresis.dynamic_model import DynamicModel, ModelDrive, ModelProbe
from flexstage.hysteresis.model import Array
from flexstage.stage import Stage
from flexstage.system import MechanicalSystem, modes
from flexstage.system.mechanical import DrivePort
from flexstage.system.statics import imposed_shape

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
    >>> from flexstage.stage.designs import design
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
        ("FLEXSTAGE_VERSION", __version__),
    ):
        raw = raw.replace(token, value)
    return raw.encode("ascii")


def contents(stage: Stage, model: DynamicModel) -> dict[str, Any]:
    """Return the variables of the .mat file of a stage, with the matrices of the model's system."""
    system = model.system
    form, step, k = linear_part(model), sampled_form(model), model.omega.size
    found = modes(system, drives="in place", count=None)
    added, held = system.drive_springs("in place")
    return {
        "name": stage.name,
        "title": stage.title,
        "mechanical_model": system.model,
        "version": f"flexstage {__version__}",
        "notes": _cell(_notes(model)),
        "step": model.step,
        # first order, continuous
        "A": form.A,
        "B": form.B,
        "C": form.C,
        "D": form.D,
        "rest": rest_shape(model),
        # from sample to sample, straight lines between the samples (first-order hold)
        "Ad": step.transition,
        "Bd": step.shifted,
        "Cd": form.C,
        "Dd": form.D + form.C @ step.end,
        "Bd_start": step.start,
        "Bd_end": step.end,
        # held between the samples (zero-order hold); A, C and D are those above
        "Bd_held": step.held,
        "Dd_held": form.D,
        "inputs": _cell(form.inputs),
        "outputs": _cell(form.outputs),
        "states": _cell(state_names(model)),
        # second order, in the coordinates of the model
        "M": system.M,
        "K": system.K,
        "K_in_place": system.K + added,
        "C_damping": damping_matrix(system),
        "drive_vectors": _columns([d.vector for d in system.drives], system.order),
        "held_vectors": held,
        "probe_vectors": _columns([p.vector for p in system.probes], system.order).T,
        "coordinates": _cell(system.coordinates),
        "shapes": found.shapes[:, :k],
        "omega": model.omega,
        "frequency_hz": model.omega / (2.0 * np.pi),
        "zeta": model.damping_ratio,
        "drives": _structs([_drive(d, system.drive(d.name)) for d in model.drives]),
        "probes": _structs([_probe(p, model) for p in model.probes]),
    }


def damping_matrix(system: MechanicalSystem) -> Array:
    r"""Return the viscous damping matrix [N s/m and so on] that gives modes their damping ratios.

    .. math:: C = N^T \mathrm{diag}(2\zeta_i\omega_i) N, \qquad
              N = \Phi^T M \left(I - \sum_j T_j v_j^T\right)

    with the modes :math:`\Phi` of the drives in place, of unit modal mass. T is the static shape of
    a rigid drive and v its vector, so that a motion that follows the rigid drives slowly is not
    damped; without rigid drives there is none.
    """
    found = modes(system, drives="in place", count=None)
    reader = found.shapes.T @ system.M
    rigid = [d for d in system.drives if d.stiffness is None]
    reader = reader - sum(np.outer(reader @ imposed_shape(system, d), d.vector) for d in rigid)
    made = (reader.T * (2.0 * found.damping_ratio * found.omega)) @ reader
    return np.asarray(0.5 * (made + made.T), dtype=np.float64)


def _notes(model: DynamicModel) -> tuple[str, ...]:
    return (
        "A, B, C, D: from the free displacements of the drives [m] (forces [N]) to the readings; "
        "amplifier, hysteresis or gain, and sensors are in the structs drives and probes",
        "Ad, Bd, Cd, Dd: x(n+1) = Ad x(n) + Bd w(n), y(n) = Cd x(n) + Dd w(n), exact for inputs of "
        "straight lines between samples; the state is that of A, B, C, D less Bd_end w(n)",
        "Bd_start, Bd_end: x(n+1) = Ad x(n) + Bd_start w(n) + Bd_end w(n+1), y = C x + D w, the "
        "same with the state of A, B, C, D",
        "Bd_held, Dd_held: x(n+1) = Ad x(n) + Bd_held w(n), y(n) = C x(n) + Dd_held w(n), for "
        "inputs that are held between samples",
        "M, K: bare stage; K_in_place: with the springs of the drives; C_damping: the damping "
        "ratios of all modes, drives in place",
        "rest: states for a unit of each input that has stood still for long",
        *model.notes,
    )


def _drive(drive: ModelDrive, port: DrivePort) -> dict[str, Any]:
    return {
        "name": drive.name,
        "kind": drive.kind,
        "unit": drive.unit,
        "gain": drive.gain,
        # a rigid drive imposes its displacement
        "stiffness": np.inf if drive.stiffness is None else drive.stiffness,
        "stroke": np.nan if port.stroke is None else port.stroke,
        "input_range": _pair(drive.input_range),
        "hysteresis": _hysteresis(drive),
        "amplifier": _amplifier(drive.amplifier),
        "creep": _creep(drive),
        "modal_gain": drive.modal_gain,
        "rate_time": drive.rate_time,
        "mode_weights": drive.mode_weights,
        "lag_weights": drive.lag_weights,
        "feedthrough": drive.feedthrough,
    }


def _hysteresis(drive: ModelDrive) -> dict[str, Any]:
    if drive.hysteresis is None:
        return {"kind": "none"}
    values: dict[str, Any] = {"kind": drive.hysteresis.kind}
    for name, value in drive.hysteresis.parameters().items():
        values[name] = value if isinstance(value, str) else np.asarray(value, dtype=np.float64)
    values["rest"] = drive.hysteresis.initial_state()
    return values


def _amplifier(amplifier: Amplifier | None) -> dict[str, Any]:
    if amplifier is None:
        return {"present": 0.0}
    return {
        "present": 1.0,
        "gain": amplifier.gain,
        "bandwidth_hz": amplifier.bandwidth_hz,
        "time_constant": amplifier.time_constant,
        "largest_rate": amplifier.largest_rate,
        "voltage_range": _pair(amplifier.voltage_range),
    }


def _creep(drive: ModelDrive) -> dict[str, Any]:
    if drive.creep is None:
        return {"lag_gains": np.zeros((0, 1)), "time_constants": np.zeros((0, 1))}
    return {
        "lag_gains": drive.creep.lag_gains,
        "time_constants": drive.creep.time_constants,
        "rate_per_decade": drive.creep.rate_per_decade,
    }


def _probe(probe: ModelProbe, model: DynamicModel) -> dict[str, Any]:
    made: dict[str, Any] = {
        "name": probe.name,
        "unit": probe.unit,
        "shape": model.probe_shapes[[p.name for p in model.probes].index(probe.name)],
    }
    sensor = probe.sensor
    if sensor is None:
        return made | {"sensor": {"present": 0.0}}
    bandwidth = sensor.bandwidth_hz
    return made | {
        "sensor": {
            "present": 1.0,
            "gain": sensor.gain,
            "offset": sensor.offset,
            "time_constant": 0.0 if bandwidth is None else 1.0 / (2.0 * np.pi * bandwidth),
            "quantisation": sensor.quantisation,
            "mains_amplitude": sensor.mains_amplitude,
            "mains_frequency_hz": sensor.mains_frequency_hz,
            "mains_phase": sensor.mains_phase,
        }
    }


def _pair(value: tuple[float, float] | None) -> Array:
    """One row: the ends, or infinities."""
    return np.array([(-np.inf, np.inf) if value is None else value])


def _columns(vectors: list[Array], order: int) -> Array:
    return np.array(vectors).reshape(len(vectors), order).T


def _cell(texts: tuple[str, ...]) -> Any:
    made = np.empty((len(texts), 1), dtype=object)
    made[:, 0] = texts
    return made


def _structs(rows: list[dict[str, Any]]) -> Any:
    """A struct array, one row of dicts with the same fields each."""
    made = np.empty((len(rows), 1), dtype=[(name, object) for name in rows[0]])
    for i, row in enumerate(rows):
        for name, value in row.items():
            made[i, 0][name] = value
    return made


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SampledForm:
    """x' = transition x + start w + end w' over one step, for inputs of straight lines."""

    transition: Array
    """What the state does to the next one, shape (n, n)."""
    start: Array
    """What the input at the start of the step does, shape (n, m)."""
    end: Array
    """What the input at its end does, shape (n, m)."""

    @property
    def held(self) -> Array:
        """What an input that is held through the step does, shape (n, m)."""
        return self.start + self.end

    @property
    def shifted(self) -> Array:
        """Input matrix for the state ``x - end w``, which needs no input of the future."""
        return self.start + self.transition @ self.end


def sampled_form(model: DynamicModel) -> SampledForm:
    """Return what one step does to the states of `linear_part`, exact to rounding.

    Modes do not act on one another, so each is taken with the lags alone: the exponential of the
    matrix of (mode, its rate over omega, lags, inputs, their rises), C. F. Van Loan, IEEE Trans.
    Autom. Control 23 (1978) 395.
    """
    from scipy.linalg import expm

    form, h, k = linear_part(model), model.step, model.omega.size
    n, m = form.B.shape
    lags = n - 2 * k
    size = 2 + lags
    block = np.zeros((k, size + 2 * m, size + 2 * m))
    index = np.array([[i, k + i, *range(2 * k, n)] for i in range(k)])
    # rates over omega, so that numbers of a block are of one size
    scale = np.ones((k, size))
    scale[:, 1] = model.omega
    own = form.A[index[:, :, None], index[:, None, :]]
    block[:, :size, :size] = h * own * scale[:, None, :] / scale[:, :, None]
    block[:, :size, size : size + m] = h * form.B[index] / scale[:, :, None]
    block[:, size : size + m, size + m :] = np.eye(m)
    e = np.asarray(expm(block), dtype=np.float64)
    transition = np.zeros((n, n))
    constant, rise = np.zeros((n, m)), np.zeros((n, m))
    for i in range(k):
        rows = index[i]
        transition[np.ix_(rows, rows)] = e[i, :size, :size] * scale[i][:, None] / scale[i][None, :]
        constant[rows] = e[i, :size, size : size + m] * scale[i][:, None]
        rise[rows] = e[i, :size, size + m :] * scale[i][:, None]
    return SampledForm(transition=transition, start=constant - rise, end=rise)


def export(given: StageExport) -> dict[str, bytes]:
    """Write the format."""
    return matlab_files(given.stage, given.analysis.system, model=given.dynamic)
