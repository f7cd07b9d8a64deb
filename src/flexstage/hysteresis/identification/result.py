"""Result of an identification: a model of the drive with its errors and warnings."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from flexstage.base.arrays import Array
from flexstage.base.short_repr import short_repr
from flexstage.files.plain import picked, plain
from flexstage.files.result import Result
from flexstage.hysteresis.chain.creep import Start
from flexstage.hysteresis.drive_model import DriveModel, parameter_unit, start_data
from flexstage.hysteresis.identification.measurement import IdentificationData
from flexstage.hysteresis.identification.model_choice import Candidate
from flexstage.hysteresis.identification.quality_report import QualityReport
from flexstage.hysteresis.identification.residuals import ParameterEstimate

if TYPE_CHECKING:
    from flexstage.hysteresis.prediction import Prediction


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Identification(Result):
    """Identified model of a drive, with its errors."""

    table_key: ClassVar[str] = "candidates"

    model: DriveModel
    """The model."""
    kind: str
    """Name of the hysteresis model."""
    rms_percent: float
    """Root mean square of output less prediction where it was fitted, over the stroke [%]. The
    prediction is that of the final model, with its one offset.
    """
    max_percent: float
    """Largest absolute value of that [%]."""
    heldout_rms_percent: float | None
    """Root mean square on cycles that the model was not fitted to [%]; None where there are none.
    """
    heldout_free_rms_percent: float | None
    """Root mean square there where the constant is fitted again [%]."""
    heldout_interval_percent: tuple[float, float] | None
    """95 % interval of the rms of another stretch of cycles, or of another record if there are
    several [%]; None if the stretches do not determine it.
    """
    heldout_median_percent: float | None
    """Median of the rms of the held-out stretches [%]."""
    heldout_worst_percent: float | None
    """Largest of these [%]."""
    heldout_max_percent: float | None
    """Largest absolute value of the prediction's error there [%]."""
    heldout_band_percent: float | None
    """Half the width of the band that holds 95 % of the errors on another stretch [%]."""
    stroke: float
    """Range of the output, in its unit."""
    noise_percent: float
    """Estimated noise of the output, over the stroke [%]."""
    parameters: tuple[ParameterEstimate, ...]
    """Individually identifiable parameters, with standard errors."""
    chain: tuple[ParameterEstimate, ...]
    """Identified values of the linear chain, with standard errors."""
    offset: ParameterEstimate
    """Reading at zero command without history, with its standard error."""
    settling: float
    """Largest change of the readings by creep from motion before the records, in the unit of the
    output.
    """
    starts: tuple[Start, ...]
    """Possible histories of the drive before the first record that fit equally well; the model has
    one of them.
    """
    warnings: tuple[str, ...]
    """Quantities that the records do not determine, and missing experiments."""
    candidates: tuple[Candidate, ...]
    """All candidate models, the selected one first."""
    measurement: IdentificationData
    """Measured data. Records of more than 40 000 samples are averaged over neighbouring samples,
    as far as the means follow the motion.
    """
    predicted: tuple[Array, ...]
    """Output of the final model for each section, shape (n,)."""
    quality: QualityReport
    """Assessment of the model, and faults of the records."""
    settings: Mapping[str, str] = field(default_factory=dict)
    """Choices that change the result."""

    records: tuple[str, ...] = ()
    """Names of the records."""
    notes: tuple[str, ...] = ()
    """Assumptions about their columns."""
    tested: "tuple[Prediction, ...]" = ()
    """Predictions of other records, if it was tested on some."""

    __repr__ = short_repr

    def data(self) -> dict[str, Any]:
        data = {
            **picked(
                self,
                "records",
                "model=kind",
                "rms_percent",
                "max_percent",
                "heldout_rms_percent",
                "heldout_free_constant_rms_percent=heldout_free_rms_percent",
                "heldout_interval_percent",
                "heldout_median_percent",
                "heldout_worst_percent",
                "heldout_max_percent",
                "heldout_band_percent",
            ),
            "start": start_data(self.model.start),
            "settling": {"value": self.settling, "unit": self.model.output_unit},
            "noise_percent": self.noise_percent,
            "fitted": self.settings["fitted"],
            "stroke": {"value": self.stroke, "unit": self.model.output_unit},
            "parameters": self.parameter_rows(),
            "chain": self.chain_rows(),
            "candidates": [
                {
                    **picked(c, "model=kind", "parameters=size", "rms_percent"),
                    **picked(c, "heldout_rms_percent"),
                    "heldout_free_constant_rms_percent": c.heldout_free_rms_percent,
                    "failed": c.failed or None,
                }
                for c in self.candidates
            ],
            **picked(self, "quality", "warnings", "notes"),
        }
        return (
            data | {"test": [prediction.data() for prediction in self.tested]}
            if self.tested
            else data
        )

    def parameter_rows(self) -> dict[str, Any]:
        """Value, standard error and unit of each parameter; arrays of them for arrays."""
        m = self.model
        rows: dict[str, Any] = {}
        for name, value in m.hysteresis.parameters().items():
            array = np.asarray(value, dtype=np.float64)
            error = np.full(array.shape, np.nan)
            for estimate in self.parameters:
                base, _, index = estimate.name.partition("[")
                if base == name:
                    place = tuple(int(i) for i in index.rstrip("]").split(",")) if index else ()
                    error[place] = estimate.standard_error
            rows[name] = {
                "value": array.tolist(),
                "standard_error": None if np.isnan(error).all() else plain(error),
                "unit": parameter_unit(self.kind, name, m.input_unit, m.output_unit),
            }
        return rows

    def chain_rows(self) -> dict[str, Any]:
        """Value, standard error and unit of delay, creep, resonance and offset."""
        m = self.model
        errors = {e.name: e.standard_error for e in self.chain}
        return {
            "delay": {
                "value": m.lag.delay if m.lag is not None else 0.0,
                "standard_error": plain(errors.get("delay")),
                "unit": "s",
            },
            "creep_per_decade": {
                "value": m.creep.rate_per_decade if m.creep is not None else 0.0,
                "standard_error": plain(errors.get("creep_per_decade")),
                "unit": "1",
            },
            "resonance": {
                "value": m.modes.frequency_hz[0] if m.modes is not None else None,
                "standard_error": plain(errors.get("resonance_hz")),
                "unit": "Hz",
            },
            "offset": {
                "value": m.offset,
                "standard_error": plain(self.offset.standard_error),
                "unit": m.output_unit,
            },
            "sign": m.sign,
        }
