"""Whether a model explains a measurement at all, and what in the records it cannot explain."""

from dataclasses import dataclass

import numpy as np

from flexstage.hysteresis.identification.families.family import Data
from flexstage.hysteresis.identification.faults import RecordFault
from flexstage.hysteresis.identification.zero_changes import zero_changes

#: Of the stroke, a fitted model of a piezo drive leaves 0.1 to 2 %, from session to session.
#: One that leaves more, and ...
_USUAL = 2.0
#: ... more than this share of what a straight line leaves, has explained no hysteresis; ...
_SHARE_OF_LINE = 1.0 / 3.0
#: ... and one that leaves this much serves nothing [% of the stroke].
_USELESS = 5.0


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


def verdict(data: Data, error_percent: float, noise_percent: float) -> Verdict:
    """Compare what the best model leaves with the noise and with what a straight line leaves.

    The error is the rms of what the best model leaves over the stroke [%], held out where there is
    such a figure; the noise is that of the output [%].
    """
    m = data.measurement
    percent = 100.0 / m.stroke
    found = list(m.findings)
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


def _line(data: Data) -> float:
    """What a straight line with the columns beside the model leaves, in the unit of the output."""
    squares, count = 0.0, 0
    for s, r, use in zip(data.measurement.sections, data.rows, data.use, strict=True):
        at = r.at[use]
        if at.size == 0:
            continue
        columns = np.column_stack((s.u[at], s.nuisance[at]))
        own = np.linalg.lstsq(columns / np.ptp(s.u), s.y[at], rcond=None)[0]
        squares += float(np.sum((s.y[at] - columns / np.ptp(s.u) @ own) ** 2))
        count += at.size
    return float(np.sqrt(squares / max(count, 1)))
