"""Whether a model explains its records, and what a reader of it should know."""

import math
from dataclasses import dataclass

import numpy as np

from flexstage.hysteresis.identification.chain_search import FoundChain
from flexstage.hysteresis.identification.faults import RecordFault
from flexstage.hysteresis.identification.measurement import IdentificationData
from flexstage.hysteresis.identification.model_choice import FittedModel, PredictionErrors
from flexstage.hysteresis.identification.model_fit import FitData
from flexstage.hysteresis.identification.zero_changes import zero_changes
from flexstage.quantities.units import readable

#: Of the stroke, a fitted model of a piezo drive leaves 0.1 to 2 %, from session to session.
#: One that leaves more, and ...
_USUAL = 2.0
#: ... more than this share of what a straight line leaves, has explained no hysteresis; ...
_SHARE_OF_LINE = 1.0 / 3.0
#: ... and one that leaves this much serves nothing [% of the stroke].
_USELESS = 5.0
#: Stages ring at some 100 Hz: faster cycles than these may show it.
_SHOWS_MODES_HZ = 10.0
#: Piezo drives creep by 1 to 3 % per decade of time: what is found beyond this is something else.
_UNUSUAL_CREEP = 0.05
#: Held-out samples over which the input moves by less than this share of its range hold no motion.
_STILL = 0.1


@dataclass(frozen=True, slots=True, kw_only=True)
class Verdict:
    """How far the best model explains the records."""

    fits: bool
    """Whether it explains them."""
    reason: str
    """Why it does not; empty where it does."""
    line_percent: float
    """What a straight line would leave, over the stroke, rms [%]."""
    findings: tuple[RecordFault, ...]
    """What is in the records that is not the motion of a drive."""

    @property
    def sentences(self) -> tuple[str, ...]:
        """What a reader should know, the verdict first."""
        own = () if self.fits else (self.reason,)
        return (*own, *(f.text for f in self.findings))


def verdict(data: FitData, error_percent: float, noise_percent: float) -> Verdict:
    """Compare what the best model leaves with the noise and with what a straight line leaves.

    The error is the rms of what the best model leaves over the stroke [%], held out where there is
    such a figure; the noise is that of the output [%].
    """
    percent = 100.0 / data.stroke
    found = list(data.findings)
    if not any(f.kind == "butterfly" for f in found):
        found += zero_changes(data)
    line = _line(data) * percent
    excess = float(np.sqrt(max(error_percent**2 - noise_percent**2, 0.0)))
    explains = excess <= _USUAL or (excess <= _USELESS and excess <= _SHARE_OF_LINE * line)
    turned = any(f.kind == "butterfly" for f in found)
    reason = ""
    if turned or not explains:
        named = sorted({f.kind for f in found} - {"spikes"})
        why = f"look at the {' and the '.join(named)} named here" if named else (
            "do input and output belong together, and is all that moves the output recorded?"
        )  # fmt: skip
        reason = (
            f"nothing here fits: the best model leaves {error_percent:.2g} % of the stroke, the "
            f"noise is {noise_percent:.2g} %, a straight line leaves {line:.2g} %, and a drive is "
            f"usually explained to {_USUAL:g} % or better; {why}"
        )
    return Verdict(fits=not reason, reason=reason, line_percent=line, findings=tuple(found))


def _line(data: FitData) -> float:
    """What a straight line with the columns beside the model leaves, in the unit of the output."""
    squares, count = 0.0, 0
    for s, r, use in zip(data.sections, data.rows, data.use, strict=True):
        at = r.at[use]
        if at.size == 0:
            continue
        columns = np.column_stack((s.u[at], s.nuisance[at]))
        own = np.linalg.lstsq(columns / np.ptp(s.u), s.y[at], rcond=None)[0]
        squares += float(np.sum((s.y[at] - columns / np.ptp(s.u) @ own) ** 2))
        count += at.size
    return float(np.sqrt(squares / max(count, 1)))


def remarks(
    tried: FittedModel,
    data: FitData,
    found: FoundChain,
    errors: PredictionErrors,
    settling: float,
    *,
    held_out: bool,
) -> tuple[str, ...]:
    """Return what a reader should know of a model, and of what its records could not tell.

    `settling` is by how much what the drive did before may change readings [unit of the output];
    `held_out` says whether samples were, which a range of the record was asked for.
    """
    return (
        *_untold(data, found),
        *data.warnings,
        *(_no_motion(data) if held_out else ()),
        *_history(settling, errors, data),
        *found.notes,
        *_unusual_creep(found, data),
        *_hidden_mode(found, data),
        *_broken(tried),
        *tried.fit.notes,
    )


def _untold(m: IdentificationData, found: FoundChain) -> tuple[str, ...]:
    """Say which values of the chain mean nothing by themselves, and why."""
    names = " and ".join(n.split("_")[0] for n, e in found.errors.items() if math.isinf(e))
    alone = f"; the values of {names} belong to this fit and mean nothing by themselves"
    if len(m.rates_hz) > 1:
        return (f"the records do not determine {names}{alone}",) if names else ()
    at = f"{m.rates_hz[0]:.3g} Hz" if m.rates_hz else "one rate"
    return (
        f"one rate only ({at}): lag, creep and hysteresis cannot be separated"
        f"{alone if names else ''}; record the same cycles at a second rate, ten times slower or "
        "faster",
    )


def _no_motion(data: FitData) -> tuple[str, ...]:
    """Say where nothing moves over what was held out."""
    if not stands_still(data):
        return ()
    return (
        "the input hardly moves over the samples that were held out: their error says nothing "
        "about the hysteresis, and the model was chosen on parts of the fitted samples; hold out "
        "whole cycles",
    )


def stands_still(data: FitData) -> bool:
    """Return whether the input hardly moves where samples are held out."""
    low, high = data.input_range
    moved = [
        float(np.ptp(s.u[r.at[~use]]))
        for s, r, use in zip(data.sections, data.rows, data.use, strict=True)
        if not use.all()
    ]
    return max(moved, default=0.0) < _STILL * (high - low)


def _history(settling: float, errors: PredictionErrors, data: FitData) -> tuple[str, ...]:
    """Say where what the drive did before matters more than the model's own error."""
    held = errors.held if errors.held is not None else errors.rms
    own = 100.0 * settling / data.stroke
    if own <= held:
        return ()
    return (
        f"creep from earlier motion changes readings by up to {own:.2g} % of the stroke, more than "
        "the error of the model: before recording, and before using the model, let the drive rest "
        "or repeat its motion for as long as the record lasts",
    )


def _unusual_creep(found: FoundChain, data: FitData) -> tuple[str, ...]:
    """Say that what was found is more than creep, unless the search has said so."""
    creep = data.chain.creep_per_decade
    if (
        not found.searched
        or creep <= _UNUSUAL_CREEP
        or any("the creep is" in n for n in found.notes)
    ):
        return ()
    return (
        f"creep of {100.0 * creep:.2g} % per decade is more than piezo drives show (1 to 3 %): a "
        "drift of the output (compare with --drift), a change of its zero, or a slow sensor may be "
        "taken for creep",
    )


def _hidden_mode(found: FoundChain, data: IdentificationData) -> tuple[str, ...]:
    """Warn of a resonance that may hide in creep: it too makes fast cycles other than slow ones."""
    if found.values.resonance_hz > 0.0 or len(data.rates_hz) < 2 or not found.searched:
        return ()
    fastest = data.rates_hz[-1]
    if fastest < _SHOWS_MODES_HZ:
        return ()
    return (
        f"no resonance was seen: one below {readable('Hz', 30.0 * fastest)} would change cycles at "
        f"{fastest:.3g} Hz by 0.1 % and more, and be taken for creep; name it, or record a small "
        "multisine about it",
    )


def _broken(tried: FittedModel) -> tuple[str, ...]:
    """Say which properties the model lacks."""
    return tuple(
        f"{tried.fit.model.title}: not {c.name}: {c.detail}"
        for c in tried.fit.model.properties()
        if not c.holds
    )
