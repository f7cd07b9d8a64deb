"""Vibration tests of an axis: natural frequency and damping."""

import numpy as np

from flexstage.base.errors import RecordError
from flexstage.experiments.campaign.plan import Campaign, Test
from flexstage.experiments.campaign.results import TestResult, figure_of
from flexstage.measure.modal.fit import fit_modes
from flexstage.measure.modal.result import ModalFit, Mode
from flexstage.measure.modal.ring_down import DecayMode, RingDown, ring_down
from flexstage.measure.spectra.estimate import estimate_response
from flexstage.measure.spectra.response import response_from_record
from flexstage.measure.uncertainty.sensor import measured
from flexstage.quantities.characteristic import MeasuredCharacteristic
from flexstage.records import Record


def evaluate_response(test: Test, records: list[Record], campaign: Campaign) -> TestResult:
    """Evaluate a forced response, from records over time or as an estimated frequency response.

    Records over time are averaged; a record over frequency is an estimated response. The figures
    are those of the mode that dominates the motion of the axis.
    """
    notes: tuple[str, ...] = ()
    added = 0.0
    if records[0].over == "frequency":
        responses = [response_from_record(record) for record in records]
        estimate = None
    else:
        if test.columns.input is None or not test.columns.output:
            raise RecordError(
                f"test '{test.name}' of kind response needs the columns of 'input' and 'output': "
                "name both"
            )
        estimate = estimate_response(
            records,
            test.columns.input,
            list(test.columns.output),
            excitation=test.excitation,  # type: ignore[arg-type]
        )
        responses, added = [estimate.response], estimate.added_damping_rate
        notes = estimate.notes
    fit = fit_modes(
        responses,
        band=test.band,
        count="auto" if test.modes is None else test.modes,
        added_damping_rate=added,
    )
    return TestResult(
        test=test,
        figures=_figures(test, campaign, _mode(test, fit)),
        details={"estimate": estimate, "response": responses[0], "fit": fit},
        notes=(*notes, *fit.notes),
    )


def evaluate_ring_down(test: Test, records: list[Record], campaign: Campaign) -> TestResult:
    """Evaluate a free decay.

    The figures are those of the strongest mode.
    """
    if len(records) != 1 or not test.columns.output:
        raise RecordError(
            f"test '{test.name}' of kind ring-down needs one record and the columns of 'output'"
        )
    fit = ring_down(
        records[0],
        list(test.columns.output),
        count=None if test.modes is None else test.modes,
    )
    return TestResult(
        test=test,
        figures=_figures(test, campaign, _strongest(test, fit)),
        details={"decay": fit},
        notes=fit.notes,
    )


def mode_of_axis(modes: tuple[Mode, ...]) -> Mode:
    """Return the mode with the largest part of the static response to the first input."""
    return max(modes, key=lambda m: float(np.nanmax(np.abs(m.residues[:, 0]))) / abs(m.pole))


def _strongest(test: Test, fit: RingDown) -> DecayMode:
    if not fit.modes:
        raise RecordError(
            f"test '{test.name}': no mode exceeds the noise: give a record that starts with the "
            "decay"
        )
    return max(fit.modes, key=lambda m: float(np.abs(m.amplitudes).max()))


def _mode(test: Test, fit: ModalFit) -> Mode:
    if not fit.modes:
        raise RecordError(f"test '{test.name}': {fit.notes[0]}; widen the band, or average more")
    return mode_of_axis(fit.modes)


def _figures(
    test: Test, campaign: Campaign, mode: Mode | DecayMode
) -> tuple[MeasuredCharacteristic, ...]:
    frequency = measured(mode.frequency_hz, campaign.instrument(test.along), role="frequency")
    return (
        figure_of(campaign, test, "natural_frequency_hz", frequency, "undamped, by modal fit"),
        figure_of(campaign, test, "damping_ratio", mode.damping_ratio, "share of the critical"),
    )
