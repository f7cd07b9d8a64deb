"""Tuning from files or from a stage: one axis, or several that a constant matrix decouples."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from flexstage.base.arrays import Array, Complex, Integers
from flexstage.base.errors import ModelError
from flexstage.control.loop_plant import controlled_axis, is_stable
from flexstage.control.measured_response import GAIN_STEP, ResponseDesign, tune_response
from flexstage.control.response_set import dense_response, shifts_of, stage_response
from flexstage.files.plain import picked
from flexstage.files.result import Result
from flexstage.measure.frf import FrfResult, frf_of_files
from flexstage.measure.requests import FrfRequest, TuneRequest
from flexstage.measure.spectra.response import MeasuredResponse
from flexstage.records.read_options import ReadOptions
from flexstage.stage import Stage
from flexstage.system.environment import PositionLoop
from flexstage.system.mechanical import MechanicalSystem


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Decoupling:
    """A constant matrix between the commands of axes and the voltages, and what it changes."""

    frequency_hz: float
    """Frequency at which it decouples [Hz]."""
    inputs: tuple[str, ...]
    """Names of the voltages."""
    outputs: tuple[str, ...]
    """Names of the readings of the axes."""
    matrix: Array
    """Voltage over command of each axis [1], shape (n, n)."""
    gains: Array
    """Reading over command of each axis at that frequency, shape (n,)."""
    lines_hz: Array
    """Lines of the cross-talk [Hz], shape (k,)."""
    before: Array
    """Largest reading of an axis by the voltages that do not move it most at the frequency, over
    that by the one that does [1], shape (k, n).
    """
    after: Array
    """Largest reading of an axis by the command of another, over that by its own [1], shape (k, n).
    """

    def data(self) -> dict[str, Any]:
        """Return it as plain data."""
        return {
            **picked(self, "frequency_hz"),
            "inputs": list(self.inputs),
            "outputs": list(self.outputs),
            "matrix": self.matrix.tolist(),
            "crosstalk_before": self.before[self.at].tolist(),
            "crosstalk_after": self.after[self.at].tolist(),
        }

    @property
    def at(self) -> int:
        """Line nearest to its frequency."""
        return int(np.argmin(np.abs(self.lines_hz - self.frequency_hz)))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class WholeMargins:
    """Margins of the loops of all axes together, for one response."""

    name: str
    """Name of the response."""
    stable: bool
    """Whether they are stable together."""
    frequency_hz: Array
    """Lines [Hz], shape (k,)."""
    sensitivity: Array
    """Largest singular value of the sensitivity, readings over their static gains [1]."""

    @property
    def sensitivity_peak(self) -> float:
        """Largest of these values [1]."""
        return float(self.sensitivity.max())


def decoupled(
    responses: Sequence[MeasuredResponse], request: TuneRequest
) -> tuple[Decoupling, list[list[MeasuredResponse]]]:
    """Return a matrix that decouples axes, and for each axis its repeated responses behind it.

    The matrix is the inverse of the real part of the mean response at the frequency, in proportion
    so that an axis moves by its command as by the voltage that moves it most.
    """
    first = responses[0]
    n = len(first.outputs)
    for response in responses:
        shape = (len(response.outputs), len(response.inputs))
        if shape != (n, n) or n < 2:
            raise ModelError(
                f"'{response.source}' has {shape[0]} outputs and {shape[1]} inputs: --decouple "
                "needs as many inputs as outputs, two or more"
            )
        if len(set(response.input_units)) > 1:
            raise ModelError(
                f"the inputs of '{response.source}' have the units "
                f"{', '.join(response.input_units)}: --decouple needs inputs of one unit, so "
                "convert them"
            )
    target = request.decouple or 0.0
    near = [int(np.argmin(np.abs(r.frequency_hz - target))) for r in responses]
    mean = np.mean([r.response[k] for r, k in zip(responses, near, strict=True)], axis=0)
    at = float(first.frequency_hz[near[0]])
    gains = np.abs(mean.real).max(axis=1)
    # over the gains, since axes may have unlike units
    relative = mean / np.where(gains > 0.0, gains, 1.0)[:, None]
    least, late = np.linalg.svd(relative.real)[1][-1], np.linalg.norm(relative.imag, 2)
    if not least > late:
        raise ModelError(
            f"the responses at {at:.4g} Hz are dependent or late: over the gains of the axes, "
            f"their real part has the smallest singular value {least:.3g}, their imaginary part "
            f"the largest {late:.3g}; decouple at a lower frequency, below the modes"
        )
    matrix = np.linalg.inv(mean.real) * gains
    axes: list[list[MeasuredResponse]] = [[] for _ in range(n)]
    for response in responses:
        behind = response.response @ matrix
        for i, repeated in enumerate(axes):
            variance = response.variance
            repeated.append(replace(
                response,
                response=behind[:, i, i, None, None],
                inputs=(f"command of {response.outputs[i]}",),
                outputs=response.outputs[i : i + 1],
                input_units=response.input_units[:1],
                output_units=response.output_units[i : i + 1],
                variance=None if variance is None else (
                    variance[:, i] @ matrix[:, i] ** 2
                )[:, None, None],
                coherence=None if response.coherence is None else response.coherence[:, [i]],
            ))  # fmt: skip
    decoupling = Decoupling(
        frequency_hz=at,
        inputs=first.inputs,
        outputs=first.outputs,
        matrix=matrix,
        gains=gains,
        lines_hz=first.frequency_hz,
        before=_cross_talk(first.response, np.abs(mean.real).argmax(axis=1)),
        after=_cross_talk(first.response @ matrix, np.arange(n)),
    )
    return decoupling, axes


def _cross_talk(response: Complex, paired: Integers) -> Array:
    """Return the largest reading of each axis by another input over that by its paired input."""
    size = np.abs(response)
    rows = np.arange(len(paired))
    by_paired = size[:, rows, paired]
    size[:, rows, paired] = 0.0
    return size.max(axis=2) / by_paired


def whole_margins(
    responses: Sequence[MeasuredResponse],
    decoupling: Decoupling,
    loops: Sequence[PositionLoop],
    request: TuneRequest,
) -> list[WholeMargins]:
    """Return the margins of all loops together, for each response and shift of its frequencies."""
    margins = []
    n, gains = len(loops), decoupling.gains
    highest = 0.5 * request.servo_rate
    lag = math.fsum(loop.lag for loop in loops)
    for response in responses:
        inside = (response.frequency_hz > 0.0) & (response.frequency_hz <= highest)
        behind = response.response[inside] @ decoupling.matrix / gains[:, None]
        lines, dense = dense_response(
            response.frequency_hz[inside], behind.reshape(-1, n * n), request.phase_step
        )
        for s in shifts_of(request, single=len(responses) == 1).tolist():
            below = (1.0 + s) * lines <= highest
            f = (1.0 + s) * lines[below]
            late = np.exp(-2j * np.pi * f * request.latency)
            control = np.array([loop.feedback(f)[0] for loop in loops]).T * gains * late[:, None]
            difference = np.eye(n) + dense[below].reshape(-1, n, n) * control[:, None, :]
            smallest = np.linalg.svd(difference, compute_uv=False)[:, -1]
            curve = np.asarray(np.linalg.det(difference), dtype=np.complex128)
            shifted = f", frequencies {100.0 * s:+.2g} %" if s else ""
            margins.append(
                WholeMargins(
                    name=response.source + shifted,
                    stable=is_stable(curve - 1.0, lag),
                    frequency_hz=f,
                    sensitivity=1.0 / np.maximum(smallest, 1e-300),
                )
            )
    return margins


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class AxesDesign(Result):
    """Position controls of several axes behind a matrix that decouples them."""

    table_key: ClassVar[str] = "all_axes"

    decoupling: Decoupling
    """The matrix, and the cross-talk."""
    axes: Sequence[ResponseDesign]
    """Control of each axis."""
    all_axes: Sequence[WholeMargins]
    """Margins of all loops together, of each response."""
    notes: tuple[str, ...]
    """Limits."""

    @property
    def by_axis(self) -> dict[str, ResponseDesign]:
        """Control of each axis by the name of its reading."""
        return dict(zip(self.decoupling.outputs, self.axes, strict=True))

    def data(self) -> dict[str, Any]:
        return {
            "kind": "tuning of axes",
            "decoupling": self.decoupling.data(),
            "axes": [axis.data() for axis in self.axes],
            "all_axes": [
                picked(one, "name", "stable", "sensitivity_peak") for one in self.all_axes
            ],
            "notes": list(self.notes),
        }


def tune_axes(responses: Sequence[MeasuredResponse], request: TuneRequest) -> AxesDesign:
    r"""Return the controls of several axes behind a constant matrix that decouples them.

    The voltages are :math:`D K e`. With G the responses and K the diagonal of the controls, each
    tuned on its element of :math:`G D`, all loops together are stable if the curve of
    :math:`\det(I + G D K)` does not encircle zero, and the largest singular value of
    :math:`S = (I + G D K)^{-1}`, readings over their static gains, is at most the sensitivity
    allowed; else all gains are reduced together (J. M. Maciejowski, Multivariable Feedback Design,
    1989).

    Parameters
    ----------
    responses : sequence of MeasuredResponse
        Repeated measurements, readings over voltages, shape (k, n, n).
    request : TuneRequest
        Structure, requirements, uncertainty, rate, delay, and frequency of the matrix.

    Returns
    -------
    AxesDesign
        The matrix, the controls, and the margins of all loops together.

    Validity
    --------
    That of `tune_response`. A constant matrix does not decouple where a mode moves several axes.
    Errors at single lines count in the margins of each axis; repetitions and shifted frequencies
    count in those of all loops together.

    Raises
    ------
    ModelError
        The response is not square, has no inverse at the frequency, or no gain is allowed.
    """
    if request.control == "iff":
        raise ModelError("iff damps one axis: omit --decouple, or choose ppf")
    decoupling, each = decoupled(responses, request)
    designs = [tune_response(one, request) for one in each]
    factor = 1.0
    while True:
        axes = [design.with_gain(factor) for design in designs]
        together = whole_margins(responses, decoupling, [axis.loop for axis in axes], request)
        if all(w.stable and w.sensitivity_peak <= request.modulus for w in together):
            break
        factor *= GAIN_STEP
        if factor < GAIN_STEP**40:
            raise ModelError(
                "the axes remain coupled: no gain keeps the largest singular value of the "
                f"sensitivity below {request.modulus:g}; decouple at another frequency, or reduce "
                "the requirement (--modulus)"
            )
    peak = max(w.sensitivity_peak for w in together)
    notes = [
        f"all loops together: Nyquist count of det(I + L) and largest singular value of the "
        f"sensitivity for {len(together)} responses; the gains of the axes may be "
        f"{peak / (peak + 1.0):.3g} to {peak / (peak - 1.0):.3g} times as large, or phases change "
        f"by {math.degrees(2.0 * math.asin(0.5 / peak)):.3g} deg, at once",
        "the matrix is constant: cross-talk returns where a mode moves several axes",
        "a control of one axis holds behind the matrix alone: --json has it, the loop files of "
        "--out do not, and budget --loop applies them without it",
    ]
    if factor < 1.0:
        notes.append(f"all gains are {factor:.3g} times those of each axis alone")
    return AxesDesign(
        request=request,
        decoupling=decoupling,
        axes=axes,
        all_axes=together,
        notes=tuple(notes),
    )


def tune_files(
    request: TuneRequest, how: ReadOptions = ReadOptions()
) -> ResponseDesign | AxesDesign:
    """Return the control for measured files, as the command ``tune`` does."""
    reading = FrfRequest(
        input=request.input,
        output=request.output,
        response=request.response,
        resolution=request.resolution,
        fit_modes=0,
    )
    if not request.frf:
        raise ModelError("nothing to tune on: give a STAGE, or measured responses by --frf")
    if request.axis is not None:
        raise ModelError(f"--axis is that of a STAGE, got '{request.axis}' with --frf: omit it")
    responses = []
    for path, one in zip(request.frf, how.of_each(len(request.frf)), strict=True):
        result = frf_of_files([Path(path)], reading, one)
        assert isinstance(result, FrfResult)
        responses.append(replace(result.response, source=Path(path).name))
    if request.decouple is not None:
        return tune_axes(responses, request)
    return tune_response(responses, request)


def tune_stage(
    stage: Stage, system: MechanicalSystem, request: TuneRequest
) -> ResponseDesign | AxesDesign:
    """Return the control for the response of a stage by its model, its drives in place.

    The delay, by default one sample, is without the hold, which the response has.
    """
    if request.frf:
        raise ModelError("tune on the model of a stage or on measured responses: omit one of both")
    of_files = [n for n in ("input", "output", "response", "resolution", "repeated")
                if getattr(request, n)]  # fmt: skip
    if of_files:
        raise ModelError(
            f"--{of_files[0]} is for measured responses, and a STAGE has none: omit it"
        )
    if request.decouple is not None and request.axis is not None:
        raise ModelError("--decouple controls all axes: omit --axis")
    delay = 1.0 / request.servo_rate if request.delay is None else request.delay
    request = replace(request, delay=delay)
    if request.decouple is not None:
        axes = [one.name for one in stage.axes]
        return tune_axes([stage_response(stage, system, axes, request.servo_rate)], request)
    axis = controlled_axis(stage, request.axis).name
    force = request.control == "iff"
    response = stage_response(stage, system, (axis,), request.servo_rate, force=force)
    return tune_response([response], request)
