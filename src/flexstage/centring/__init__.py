"""An encoder scale on a turning table: its eccentricity, the move that removes it, its errors."""

from typing import TYPE_CHECKING

from flexstage.lazy import import_on_use

if TYPE_CHECKING:
    from flexstage.centring.asynchronous_motion import AxisMotion, axis_motion
    from flexstage.centring.bench import CentreReading, Table, VirtualBench
    from flexstage.centring.calibration_table import CalibrationTable
    from flexstage.centring.cross_calibration import cross_calibration
    from flexstage.centring.eccentricity import (
        HeadReadings,
        as_readings,
        eccentricity,
        eccentricity_from_harmonics,
    )
    from flexstage.centring.equal_division import equal_division
    from flexstage.centring.geometry import (
        ARCSEC,
        SCALE_KINDS,
        ScaleKind,
        direction_vector,
        exact_error,
        exact_run_out,
        first_order_error,
        in_turning_frame,
    )
    from flexstage.centring.harmonic_fit import Harmonic, HarmonicFit
    from flexstage.centring.harmonics import fit_harmonics, fit_many
    from flexstage.centring.head_averaging import HeadAveraging, against_reference, head_averaging
    from flexstage.centring.in_scale import scale_harmonic
    from flexstage.centring.indicators import IndicatorReadings, RunOut, run_out
    from flexstage.centring.move import PlannedMove, planned_move
    from flexstage.centring.move_model import MoveModel
    from flexstage.centring.outliers import Outlier
    from flexstage.centring.polar import direction_estimate, length_estimate
    from flexstage.centring.positioner import Positioner, VirtualPositioner
    from flexstage.centring.procedure import Centring, CentringStep, centre
    from flexstage.centring.scale_centre import Eccentricity
    from flexstage.centring.self_calibration import order_visibility, self_calibration
    from flexstage.centring.trial_moves import OrderResponse, response_to_moves
    from flexstage.centring.turns import MeanTurn, Turns, find_turns, mean_turn, unwrap_error
    from flexstage.centring.virtual_table import ScaleErrors, VirtualTable, scale_errors

__all__ = [
    "ARCSEC",
    "SCALE_KINDS",
    "AxisMotion",
    "CalibrationTable",
    "CentreReading",
    "Centring",
    "CentringStep",
    "Eccentricity",
    "Harmonic",
    "HarmonicFit",
    "HeadAveraging",
    "HeadReadings",
    "IndicatorReadings",
    "MeanTurn",
    "MoveModel",
    "OrderResponse",
    "Outlier",
    "PlannedMove",
    "Positioner",
    "RunOut",
    "ScaleErrors",
    "ScaleKind",
    "Table",
    "Turns",
    "VirtualBench",
    "VirtualPositioner",
    "VirtualTable",
    "against_reference",
    "as_readings",
    "axis_motion",
    "centre",
    "cross_calibration",
    "direction_estimate",
    "direction_vector",
    "eccentricity",
    "eccentricity_from_harmonics",
    "equal_division",
    "exact_error",
    "exact_run_out",
    "find_turns",
    "first_order_error",
    "fit_harmonics",
    "fit_many",
    "head_averaging",
    "in_turning_frame",
    "length_estimate",
    "mean_turn",
    "order_visibility",
    "planned_move",
    "response_to_moves",
    "run_out",
    "scale_errors",
    "scale_harmonic",
    "self_calibration",
    "unwrap_error",
]

import_on_use(__name__)
