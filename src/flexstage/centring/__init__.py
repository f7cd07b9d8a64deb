"""An encoder scale on a turning table: its eccentricity, the move that removes it, its errors."""

from typing import TYPE_CHECKING

from flexstage.base.lazy import import_on_use

if TYPE_CHECKING:
    from flexstage.centring.asynchronous_motion import axis_motion, error_motion, mean_turn
    from flexstage.centring.calibration import (
        ScaleReadings,
        against_reference,
        cross_calibration,
        equal_division,
        order_visibility,
        self_calibration,
    )
    from flexstage.centring.calibration_moves import response_to_moves
    from flexstage.centring.calibration_table import CalibrationTable, Division
    from flexstage.centring.closure import Closure, dual_closure, simple_closure
    from flexstage.centring.eccentricity import Eccentricity, HeadReadings, eccentricity, run_out
    from flexstage.centring.geometry import (
        ARCSEC,
        exact_error,
        first_order_error,
    )
    from flexstage.centring.harmonic_fit import Harmonic
    from flexstage.centring.harmonics import fit_harmonics, fit_many
    from flexstage.centring.move import Positioner
    from flexstage.centring.procedure import CentreReading, Centring, centre
    from flexstage.centring.table_file import RotaryTable, read_table
    from flexstage.centring.turns import Turns

__all__ = [
    "ARCSEC",
    "CalibrationTable",
    "CentreReading",
    "Centring",
    "Closure",
    "Division",
    "Eccentricity",
    "Harmonic",
    "HeadReadings",
    "Positioner",
    "RotaryTable",
    "ScaleReadings",
    "Turns",
    "against_reference",
    "axis_motion",
    "centre",
    "cross_calibration",
    "dual_closure",
    "eccentricity",
    "equal_division",
    "error_motion",
    "exact_error",
    "first_order_error",
    "fit_harmonics",
    "fit_many",
    "mean_turn",
    "order_visibility",
    "read_table",
    "response_to_moves",
    "run_out",
    "self_calibration",
    "simple_closure",
]

import_on_use(__name__)
