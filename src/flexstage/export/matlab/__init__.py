"""Files for MATLAB and Octave, and the variables of their .mat file."""

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
from flexstage.export.simulink.matlab_text import KEYWORDS, cell, mat_file
from flexstage.hysteresis import Amplifier
from flexstage.hysteresis.dynamic_model import DynamicModel, ModelDrive, ModelProbe
from flexstage.hysteresis.model import Array
from flexstage.stage import Stage
from flexstage.system import MechanicalSystem, modes
from flexstage.system.mechanical import DrivePort
from flexstage.system.statics import imposed_shape

_TEMPLATES = ("stage_script.m", "stage_step.m")
_LONGEST = 63 - len("_step")  # of a name in MATLAB


def matlab_files(stage: Stage, model: DynamicModel, *, name: str | None = None) -> dict[str, bytes]:
    """Return a stage for MATLAB and Octave.

    ``NAME.mat`` (level 5) has the state-space matrices, continuous and discrete, mass, damping and
    stiffness, modes, and the drives with hysteresis, amplifier and creep. ``NAME.m`` loads it,
    makes state spaces if there is a control toolbox, draws Bode diagrams and computes a time
    response. ``NAME_step.m`` is one exact step of the full model.

    NAME, a name in MATLAB, is by default that of the stage (`matlab_name`).

    Notes
    -----
    Validity: ``NAME_step.m`` steps linear drives and Bouc-Wen hysteresis of exponent 1, with modes
    of a damping ratio below 1; for other hysteresis the file has only the parameters.

    Examples
    --------
    >>> from flexstage.stage.designs import design
    >>> from flexstage.hysteresis import dynamic_model
    >>> from flexstage.lumped import lumped_system
    >>> stage = design("vgtu-piezo")
    >>> list(matlab_files(stage, dynamic_model(stage, lumped_system(stage))))
    ['vgtu_piezo.mat', 'vgtu_piezo.m', 'vgtu_piezo_step.m']
    """
    if not model.probes:
        raise ModelError(f"stage '{model.name}' has no probe: there is nothing to read from it")
    name = matlab_name(model.name) if name is None else name
    if not re.fullmatch(rf"[A-Za-z]\w{{0,{_LONGEST - 1}}}", name, re.ASCII):
        raise ModelError(
            f"'{name}' is not a valid name in MATLAB: it must begin with a letter and have at "
            f"most {_LONGEST} letters, digits and _"
        )
    return {
        f"{name}.mat": mat_file(contents(stage, model)),
        f"{name}.m": _text(_TEMPLATES[0], name, model.title),
        f"{name}_step.m": _text(_TEMPLATES[1], name, model.title),
    }


def matlab_name(text: str) -> str:
    """Return a valid name in MATLAB and C, of at most 58 letters, digits, underscores.

    It is neither a keyword nor a function or variable of the files.

    Examples
    --------
    >>> matlab_name("2-axis stage"), matlab_name("sin")
    ('stage_2_axis_stage', 'stage_sin')
    """
    name = re.sub(r"\W+", "_", text, flags=re.ASCII).strip("_")
    # a script with the name of a function or keyword would hide it
    if not name or not name[0].isalpha() or name.lower() in _used_words():
        name = f"stage_{name}".rstrip("_")
    return name[:_LONGEST]


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
    # only ASCII, since MATLAB reads files in the local encoding on some systems
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
    shapes = modes(system, drives="in place", count=None)
    added, imposed = system.drive_springs("in place")
    return {
        "name": stage.name,
        "title": stage.title,
        "mechanical_model": system.model,
        "version": f"flexstage {__version__}",
        "notes": cell(_notes(model)),
        "step": model.step,
        # first order, continuous
        "A": form.A,
        "B": form.B,
        "C": form.C,
        "D": form.D,
        "rest": rest_shape(model),
        # discrete, straight lines between samples (first-order hold)
        "Ad": step.transition,
        "Bd": step.shifted,
        "Cd": form.C,
        "Dd": form.D + form.C @ step.end,
        "Bd_start": step.start,
        "Bd_end": step.end,
        # discrete, held between samples (zero-order hold); A, C and D as above
        "Bd_held": step.zero_order_hold,
        "Dd_held": form.D,
        "inputs": cell(form.inputs),
        "outputs": cell(form.outputs),
        "states": cell(state_names(model)),
        # second order, in the coordinates of the model
        "M": system.M,
        "M_in_place": system.mass_matrix("in place"),
        "K": system.K,
        "K_in_place": system.K + added,
        "C_damping": damping_matrix(system),
        "drive_vectors": _columns([d.vector for d in system.drives], system.order),
        "held_vectors": imposed,
        "probe_vectors": _columns([p.vector for p in system.probes], system.order).T,
        "coordinates": cell(system.coordinates),
        "shapes": shapes.shapes[:, :k],
        "omega": model.omega,
        "frequency_hz": model.omega / (2.0 * np.pi),
        "zeta": model.damping_ratio,
        "drives": _structs([_drive(d, system.drive(d.name)) for d in model.drives]),
        "probes": _structs([_probe(p, model) for p in model.probes]),
    }


def damping_matrix(system: MechanicalSystem) -> Array:
    r"""Return the viscous damping matrix [N s/m etc.] with the damping ratios of the modes.

    .. math:: C = N^T \mathrm{diag}(2\zeta_i\omega_i) N, \qquad
              N = \Phi^T M \left(I - \sum_j T_j v_j^T\right)

    with the modes :math:`\Phi` of the drives in place, of unit modal mass. T is the static shape of
    a rigid drive and v its vector: a motion that follows the rigid drives slowly is not damped.
    Without rigid drives the sum is zero.
    """
    all_modes = modes(system, drives="in place", count=None)
    reader = all_modes.shapes.T @ system.mass_matrix("in place")
    rigid = [d for d in system.drives if d.stiffness is None]
    reader = reader - sum(np.outer(reader @ imposed_shape(system, d), d.vector) for d in rigid)
    damping = (reader.T * (2.0 * all_modes.damping_ratio * all_modes.omega)) @ reader
    return np.asarray(0.5 * (damping + damping.T), dtype=np.float64)


def _notes(model: DynamicModel) -> tuple[str, ...]:
    return (
        "A, B, C, D: from the free displacements of the drives [m] (forces [N]) to the readings; "
        "amplifier, hysteresis or gain, and sensors are in the structs drives and probes",
        "Ad, Bd, Cd, Dd: x(n+1) = Ad x(n) + Bd w(n), y(n) = Cd x(n) + Dd w(n), exact for inputs of "
        "straight lines between samples; the state is that of A, B, C, D minus Bd_end w(n)",
        "Bd_start, Bd_end: x(n+1) = Ad x(n) + Bd_start w(n) + Bd_end w(n+1), y = C x + D w, the "
        "same with the state of A, B, C, D",
        "Bd_held, Dd_held: x(n+1) = Ad x(n) + Bd_held w(n), y(n) = C x(n) + Dd_held w(n), for "
        "inputs held between samples (zero-order hold)",
        "M, K: bare stage; M_in_place, K_in_place: with masses and springs of the drives; "
        "C_damping: the damping ratios of all modes, drives in place",
        "rest: settled states for a unit of each input",
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
    values: dict[str, Any] = {
        "name": probe.name,
        "unit": probe.unit,
        "shape": model.probe_shapes[[p.name for p in model.probes].index(probe.name)],
    }
    sensor = probe.sensor
    if sensor is None:
        return values | {"sensor": {"present": 0.0}}
    bandwidth = sensor.bandwidth_hz
    return values | {
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
    """Return one row: the limits, or infinities."""
    return np.array([(-np.inf, np.inf) if value is None else value])


def _columns(vectors: list[Array], order: int) -> Array:
    return np.array(vectors).reshape(len(vectors), order).T


def _structs(rows: list[dict[str, Any]]) -> Any:
    """Return a struct array from dicts with the same fields."""
    structs = np.empty((len(rows), 1), dtype=[(name, object) for name in rows[0]])
    for i, row in enumerate(rows):
        for name, value in row.items():
            structs[i, 0][name] = value
    return structs


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SampledForm:
    """Discrete form x' = transition x + start w + end w' over one step, for straight inputs."""

    transition: Array
    """State transition matrix, shape (n, n)."""
    start: Array
    """Input matrix at the start of the step, shape (n, m)."""
    end: Array
    """Input matrix at the end of the step, shape (n, m)."""

    @property
    def zero_order_hold(self) -> Array:
        """Input matrix for an input held over the step, shape (n, m)."""
        return self.start + self.end

    @property
    def shifted(self) -> Array:
        """Input matrix for the state ``x - end w``, without the next input."""
        return self.start + self.transition @ self.end


def sampled_form(model: DynamicModel) -> SampledForm:
    """Return the discrete form of `linear_part`, exact to rounding.

    Modes are uncoupled: each has the exponential of a matrix of (mode, its rate over omega, lags,
    inputs, their rises), C. F. Van Loan, IEEE Trans. Autom. Control 23 (1978) 395.
    """
    from scipy.linalg import expm

    form, h, k = linear_part(model), model.step, model.omega.size
    n, m = form.B.shape
    lags = n - 2 * k
    size = 2 + lags
    block = np.zeros((k, size + 2 * m, size + 2 * m))
    index = np.array([[i, k + i, *range(2 * k, n)] for i in range(k)])
    # rates over omega, so that the numbers of a block have similar size
    scale = np.ones((k, size))
    scale[:, 1] = model.omega
    local_rows = form.A[index[:, :, None], index[:, None, :]]
    block[:, :size, :size] = h * local_rows * scale[:, None, :] / scale[:, :, None]
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


def export(stage_export: StageExport) -> dict[str, bytes]:
    """Return the files of the format."""
    return matlab_files(stage_export.stage, stage_export.dynamic)
