"""Hits of a hammer in the channel of its force, and steps in that of a drive."""

from dataclasses import dataclass

import numpy as np

from flexstage.arrays import Array
from flexstage.errors import RecordError

# without a length of segment, pulses nearer than this share of the longest gap belong together
_TOGETHER = 0.1
# a contact is told from noise at so many times its rms
_ABOVE_NOISE = 6.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Pulse:
    """A part of a signal above a level."""

    start: int
    """Its first sample."""
    stop: int
    """The sample behind its last."""

    @property
    def width(self) -> int:
        """Number of samples."""
        return self.stop - self.start


def find_pulses(values: Array, trigger: float) -> list[Pulse]:
    """Return the parts of a signal above a share of its greatest value.

    The signal is 0 at rest; parts nearer than half the wider one are one.

    Examples
    --------
    >>> find_pulses(np.array([0.0, 0.0, 3.0, 2.0, 0.1, 0.0, 0.0, 1.0, 0.0]), 0.25)
    [Pulse(start=2, stop=4), Pulse(start=7, stop=8)]
    """
    above = values > trigger * float(values.max())
    edges = np.flatnonzero(np.diff(np.concatenate(([False], above, [False]))))
    found: list[Pulse] = []
    for start, stop in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
        if found and 2 * (start - found[-1].stop) < max(found[-1].width, stop - start):
            found[-1] = Pulse(start=found[-1].start, stop=stop)
        else:
            found.append(Pulse(start=start, stop=stop))
    return found


def grouped(
    pulses: list[Pulse], size: int, pre: int, segment: int | None
) -> tuple[list[list[Pulse]], int]:
    """Return which pulses start a segment, with those that fall into it, and its length.

    The one that starts a segment is first in its group; `pre` samples of a segment are before it.
    The length is found from the gaps between pulses where not given.
    """
    if not pulses:
        raise RecordError("no hit was found in the record: is the input the right column?")
    starts = np.array([p.start for p in pulses])
    gaps = np.diff(np.concatenate((starts, [size])))
    least = _TOGETHER * float(gaps.max()) if segment is None else float(segment - pre)
    groups = [[pulses[0]]]
    for pulse in pulses[1:]:
        if pulse.start - groups[-1][0].start < least:
            groups[-1].append(pulse)
        else:
            groups.append([pulse])
    if segment is None:
        from scipy.fft import prev_fast_len

        heads = [g[0].start for g in groups]
        room = int(np.diff(heads).min()) if len(heads) > 1 else size - heads[0] + pre
        if room < 8:
            raise RecordError(
                f"there are {room} samples from one hit to the next: give the samples of a segment"
            )
        segment = int(prev_fast_len(room, real=True) or room)
    return groups, segment


def second_contact(force: Array, pulse: Pulse, share: float, noise: float) -> tuple[int, float]:
    """Return where the hammer touches again after its main contact.

    `share` is what counts as a contact, relative to the peak; `noise` the rms of the force at rest.
    Returned are the sample of the second peak, -1 where there is none, and its size relative to the
    first.
    """
    peak = float(force[pulse.start : pulse.stop].max())
    level = max(share * peak, _ABOVE_NOISE * noise)
    low = np.flatnonzero(force[pulse.stop :] < level)
    if low.size == 0:
        return -1, 0.0
    # past the foot of the main contact, which may tremble about the level
    behind = pulse.stop + int(low[0]) + max(pulse.width // 2, 1)
    rest = force[behind:]
    if rest.size == 0 or rest.max() <= level:
        return -1, 0.0
    at = behind + int(np.argmax(rest))
    return at, float(force[at]) / peak
