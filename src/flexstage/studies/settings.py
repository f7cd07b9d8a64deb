"""Settings of the drives that make a centring move, in turns or volts, and what to read after."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from flexstage.base.arrays import Array
from flexstage.base.errors import ModelError
from flexstage.centring.error_budget import allowed_eccentricity
from flexstage.centring.from_records import CentredRecords, with_table
from flexstage.centring.requests import CentreRequest
from flexstage.centring.table_file import read_table
from flexstage.files.plain import picked
from flexstage.stage import Drive, PiezoStack, Screw, Stage
from flexstage.stage.assumptions import BACKLASH, CONVERTER_BITS, VOLTAGE_RANGE
from flexstage.stage.designs import find_stage
from flexstage.studies.models import analyse_model
from flexstage.virtual.as_built import loop_share

#: Relative standard uncertainty of a transmission ratio by a model before it is measured [1].
RATIO_UNCERTAINTY = 0.05
#: Part of a turn by which a screw is turned back further than needed, to approach it forwards.
_BACK = 0.1
#: Largest number of moves whose success is stated.
_MOVES = 4
#: Drawn moves for its probability.
_DRAWS = 20_000
#: Elongation that is none [m].
_LEAST = 1e-15
#: Decimals of a predicted centre [m].
_DECIMALS = 12


@dataclass(frozen=True, slots=True, kw_only=True)
class DriveSetting:
    """One drive of a move."""

    drive: str
    """Name of the drive."""
    elongation: float
    """Change of its length [m]."""
    turns: float | None
    """Turns of a screw, positive forwards; None for another drive."""
    voltage: float | None
    """Change of the voltage of a stack, without its hysteresis [V]; None for another drive."""
    back: float
    """Turns, or volts, to go back first, so that the drive ends in its forward direction."""
    eccentricity: float
    """Eccentricity after this drive and those before it [m]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MoveSettings:
    """Settings of a centring move."""

    stage: str
    """Name of the stage."""
    drives: tuple[DriveSetting, ...]
    """The drives, in their order."""
    radius: float | None
    """Radius at which the scale is read [m]; None where not known."""
    target: float | None
    """Wanted eccentricity [m]."""
    success: tuple[float, ...]
    """Probability that the target is reached after one move, two, and so on [1]."""
    notes: tuple[str, ...]
    """Remarks."""

    def to_dict(self) -> dict[str, Any]:
        """Return plain data in SI units; volts in V, turns in turns."""
        return picked(self, "stage", "target", "success", "notes") | {
            "drives": [
                picked(d, "drive", "elongation", "turns", "voltage", "back", "eccentricity")
                for d in self.drives
            ]
        }


def move_settings(
    stage: Stage,
    move: Array,
    uncertainty: Array,
    *,
    radius: float | None = None,
    target: float | None = None,
    model: str = "lumped",
) -> MoveSettings:
    r"""Return the settings of the drives of a stage for a move along its axes x and y.

    The elongations are :math:`w = J^+ \Delta`, with the Jacobian J of the model; an elastic drive
    of stiffness k under the force F needs F / k besides. Each move is measured before it is made;
    the probability that its target is reached comes from drawn moves: each leaves, by axis, a share
    of the eccentricity before it by the error of the ratio, which is the same in every move, and by
    the loop of a stack, then the uncertainty of the measured eccentricity and up to half a step.

    Parameters
    ----------
    stage : Stage
        The stage.
    move : numpy.ndarray
        Displacement of the scale along the axes of the stage that centres it [m], shape (2,).
    uncertainty : numpy.ndarray
        Its standard uncertainty along each axis [m], shape (2,).
    radius : float, optional
        Radius at which the scale is read [m].
    target : float, optional
        Wanted eccentricity [m].
    model : str
        Model of the stage.

    Returns
    -------
    MoveSettings
        One setting by drive.

    Raises
    ------
    ModelError
        The move is not finite, the stage does not move along x and y, a drive has neither turns nor
        volts, or the move exceeds a stroke.

    Notes
    -----
    Validity: small moves within the linear range; ratios are those of the model, with a standard
    uncertainty of 5 %, which no later move is taken to know better. The loop of a stack leaves up
    to half its relative width of each move.
    """
    if not np.isfinite(move).all():
        raise ModelError("the move must be finite, got " + ", ".join(f"{v:g} m" for v in move))
    coupling = analyse_model(stage, model).coupling
    if coupling is None or not {"x", "y"} <= set(coupling.names):
        raise ModelError(f"{stage.name} does not move along x and y: give a stage that does")
    rows = [coupling.names.index(axis) for axis in ("x", "y")]
    J = coupling.jacobian[rows]
    elongations = np.linalg.pinv(J) @ move
    # of the drives that move an axis together, the one with the largest share stands for all
    drives = [
        (axis, stage.drive(coupling.drives[k]), float(abs(row[k])))
        for axis, row in zip(("x", "y"), J, strict=True)
        for k in (int(np.argmax(np.abs(row))),)
    ]
    settings, at = [], -np.asarray(move, dtype=np.float64)
    forces = coupling.forces @ elongations
    for name, column, elongation, force in zip(
        coupling.drives, J.T, elongations, forces, strict=True
    ):
        if abs(elongation) <= max(_LEAST, 1e-9 * float(np.abs(elongations).max(initial=0.0))):
            continue
        drive = stage.drive(name)
        at = at + column * elongation
        turns, voltage = _amount(drive, float(elongation), float(force))
        settings.append(
            DriveSetting(
                drive=name,
                elongation=float(elongation),
                turns=turns,
                voltage=voltage,
                back=_back(drive, float(elongation), turns),
                eccentricity=float(np.hypot(*at.round(_DECIMALS))),
            )
        )
    return MoveSettings(
        stage=stage.name,
        drives=tuple(settings),
        radius=radius,
        target=target,
        success=() if not target else tuple(_success(stage, move, drives, uncertainty, target)),
        notes=tuple(_notes([stage.drive(name) for name in coupling.drives], settings)),
    )


def settings_of(centred: CentredRecords, source: str) -> MoveSettings:
    """Return the settings of a stage, by name or file, for the move of the last setup.

    Trial moves give the move along the axes of the stage, however it is mounted.
    """
    last, trial = centred.reports[-1], centred.trial or {}
    notes: list[str] = []
    if "centre" in trial:
        centre = trial["centre"]
        move = np.array(centre["move_from_last"])
    elif "move" in last:
        centre = last["move"]
        move = np.array([centre["x"], centre["y"]])
        notes.append(
            "the mounting angle is taken as stated and the stage as not mirrored: trial moves "
            "(--stage-at) find both"
        )
    else:
        raise ModelError(
            "the records give no eccentricity, so that there is no move to set: give --radius and "
            "--kind, or --table; for a magnet trial moves by --stage-at"
        )
    request, target, radius = centred.request, None, None
    if isinstance(request, CentreRequest):
        radius = with_table(request).radius
        if request.table is not None:
            try:
                target = allowed_eccentricity(read_table(request.table))
            except ModelError as error:
                notes.append(str(error))
    uncertainty = np.array([centre["uncertainty_x"], centre["uncertainty_y"]])
    settings = move_settings(find_stage(source), move, uncertainty, radius=radius, target=target)
    return replace(settings, notes=(*settings.notes, *notes))


def _amount(drive: Drive, elongation: float, force: float) -> tuple[float | None, float | None]:
    """Return turns of a screw, or volts of a stack, that also make up for its own compression."""
    stiffness, stroke = drive.mounted.stiffness, drive.mounted.stroke
    if stroke is None or not isinstance(drive, Screw | PiezoStack):
        raise ModelError(
            f"drive '{drive.name}' has neither turns nor volts: give a screw or a piezo stack"
        )
    free = elongation + (force / stiffness if stiffness else 0.0)
    if abs(free) > stroke:
        raise ModelError(
            f"the move needs {1e6 * abs(free):.1f} um of drive '{drive.name}', whose stroke "
            f"is {1e6 * stroke:.1f} um: mount the scale closer to the axis, or take a stage with a "
            "larger stroke"
        )
    if isinstance(drive, Screw):
        return free / drive.pitch, None
    low, high = drive.voltage_range or VOLTAGE_RANGE
    return None, (high - low) * free / stroke


def _back(drive: Drive, elongation: float, turns: float | None) -> float:
    """Return how far a drive goes back first; nothing if it moves forwards."""
    if elongation >= 0.0 or not isinstance(drive, Screw) or turns is None:
        return 0.0
    return -turns + max(_BACK, 10.0 * BACKLASH / drive.pitch)


def _success(
    stage: Stage,
    move: Array,
    drives: Sequence[tuple[str, Drive, float]],
    uncertainty: Array,
    target: float,
) -> Iterator[float]:
    """Return the probability that the eccentricity is below the target after each move.

    `drives` are axis, drive and ratio of x and y.
    """
    loop, step = np.zeros(2), np.empty(2)
    for k, (axis, drive, ratio) in enumerate(drives):
        stroke = drive.mounted.stroke or 0.0
        if isinstance(drive, PiezoStack):
            loop[k] = loop_share(stage, axis, ratio * stroke)
        step[k] = ratio * (drive.smallest_displacement or stroke / 2**CONVERTER_BITS)
    rng = np.random.default_rng(0)
    left = np.tile(move, (_DRAWS, 1))
    gain = rng.normal(0.0, RATIO_UNCERTAINTY, left.shape)
    for _ in range(_MOVES):
        left = left * (gain + loop * rng.uniform(-0.5, 0.5, left.shape))
        left += rng.normal(0.0, uncertainty, left.shape)
        left += step * rng.uniform(-0.5, 0.5, left.shape)
        yield float(np.mean(np.hypot(*left.T) < target))


def _notes(drives: Sequence[Drive], settings: Sequence[DriveSetting]) -> Iterator[str]:
    if not settings:
        yield "no move is needed"
        return
    if any(isinstance(d, Screw) for d in drives):
        yield (
            "screws end forwards, which takes out their backlash: for a move back, turn back as "
            "far as stated, then forwards to the setting"
        )
    if any(isinstance(d, PiezoStack) for d in drives):
        yield (
            "voltages are without hysteresis: go to the lowest voltage first and approach every "
            "setting from below"
        )
    yield (
        f"the ratios are those of the model, taken as {100.0 * RATIO_UNCERTAINTY:.0f} % uncertain: "
        "measure again after the move"
    )
