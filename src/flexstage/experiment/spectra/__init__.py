"""Spectra of measured records: frequency responses and power spectral densities."""

from typing import TYPE_CHECKING

from flexstage.lazy import import_on_use

if TYPE_CHECKING:
    from flexstage.experiment.spectra.density import SpectralDensity, spectral_density
    from flexstage.experiment.spectra.estimate import ResponseEstimate, estimate_response
    from flexstage.experiment.spectra.estimators import Estimator, transfer
    from flexstage.experiment.spectra.from_record import response_from_record
    from flexstage.experiment.spectra.options import Excitation, HitOptions, PeriodOptions
    from flexstage.experiment.spectra.response import MeasuredResponse
    from flexstage.experiment.spectra.sums import Spectra

__all__ = [
    "Estimator",
    "Excitation",
    "HitOptions",
    "MeasuredResponse",
    "PeriodOptions",
    "ResponseEstimate",
    "Spectra",
    "SpectralDensity",
    "estimate_response",
    "response_from_record",
    "spectral_density",
    "transfer",
]

import_on_use(__name__)
