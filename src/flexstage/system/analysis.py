"""Analysis of a stage by one model: statics, modes, responses, characteristics."""

from dataclasses import dataclass
from functools import cached_property

from flexstage.base.provenance import Provenance, provenance
from flexstage.base.short_repr import short_repr
from flexstage.quantities.characteristic import Characteristics
from flexstage.stage import Stage
from flexstage.system.characteristics import MODES_SEARCHED, axis_states, every_characteristic
from flexstage.system.coupled_axes import CoupledAxes
from flexstage.system.mechanical import DriveCondition, MechanicalSystem
from flexstage.system.modes import Modes, modes
from flexstage.system.response import (
    FrequencyResponse,
    default_frequencies_hz,
    response_of_modes,
)
from flexstage.system.statics import AxisAnalysis
from flexstage.system.thermal import thermal_notes
from flexstage.system.thermal_transient import transient_notes

_CONDITIONS: tuple[DriveCondition, ...] = ("removed", "in place", "locked")


@dataclass(frozen=True, kw_only=True, eq=False)
class Analysis:
    """Results of one model of a stage."""

    stage: Stage
    """The stage."""
    system: MechanicalSystem
    """The system that was analysed."""
    axes: tuple[AxisAnalysis, ...]
    """Static state of each axis."""
    modes: dict[DriveCondition, Modes]
    """Lowest modes by condition of the drives."""
    every_mode: dict[DriveCondition, Modes]
    """All modes by condition of the drives."""
    characteristics: Characteristics
    """The characteristics."""
    validity: tuple[str, ...]
    """Limits of validity of the results."""
    provenance: Provenance
    """Provenance of the results."""
    coupling: CoupledAxes | None = None
    """Coupling of all drives and axes, where there are several drives."""

    __repr__ = short_repr

    @cached_property
    def responses(self) -> tuple[FrequencyResponse, ...]:
        """Response of each axis' probe to its drives, drives removed and in place."""
        return tuple(
            response_of_modes(
                self.system, self.every_mode[condition], frequency_hz, drive, axis.probe
            )
            for axis in self.system.axes
            for condition in _CONDITIONS[:2]
            if condition in self.modes
            for frequency_hz in (default_frequencies_hz(self.modes[condition]),)
            for drive in axis.drives
        )

    @property
    def hinge_stress(self) -> dict[str, dict[str, float]]:
        """Largest equivalent stress of each hinge at full stroke, by axis [Pa]."""
        return {a.axis: a.static.hinge_stress for a in self.axes}


def analyse(stage: Stage, system: MechanicalSystem) -> Analysis:
    """Analyse a stage by one of its systems.

    Parameters
    ----------
    stage : Stage
        The stage.
    system : MechanicalSystem
        A model of it.

    Returns
    -------
    Analysis
        Statics of each axis, modes in each condition of the drives, responses, characteristics.

    Raises
    ------
    ModelError
        The stage is a mechanism, or a drive has no stroke.
    """
    states = axis_states(stage, system)
    # without drives the three conditions are one
    conditions = _CONDITIONS if system.drives else _CONDITIONS[:1]
    every: dict[DriveCondition, Modes] = {
        c: modes(system, drives=c, count=None) for c in conditions
    }
    lowest_modes: dict[DriveCondition, Modes] = {
        c: every[c].lowest(MODES_SEARCHED) for c in conditions
    }
    rows = every_characteristic(
        stage, system, states, lowest_modes["removed"], lowest_modes.get("in place")
    )
    return Analysis(
        stage=stage,
        system=system,
        axes=states.axes,
        modes=lowest_modes,
        every_mode=every,
        characteristics=Characteristics(rows),
        validity=(
            *system.validity,
            *_missing(system, lowest_modes["removed"]),
            *thermal_notes(stage, system),
            *transient_notes(stage, system),
        ),
        provenance=provenance(stage, system.settings),
        coupling=states.coupling,
    )


def _missing(system: MechanicalSystem, bare: Modes) -> tuple[str, ...]:
    """Return notes on missing axes and unconstrained bodies."""
    notes = []
    if not system.axes:
        notes.append(
            "The stage has no axis (a drive with the probe that reads it): only modes are computed."
        )
    f = bare.frequency_hz
    # rounding leaves 1e-8 of the highest frequency in place of nothing
    loose = int((f <= 1e-6 * f.max(initial=0.0)).sum())
    if loose:
        notes.append(f"{loose} of these modes, at 0 Hz, deform no hinge: a body is unconstrained.")
    return tuple(notes)
