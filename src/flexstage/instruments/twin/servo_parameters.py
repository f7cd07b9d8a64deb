"""Settings of a position control as numbered parameters: some notches, in units of um."""

from flexstage.instruments.servo import Notch, ServoSettings

#: Notches that a client can set.
NOTCHES = 4

_MICRO = 1e-6


class ServoDraft:
    """Settings while they are changed one by one.

    A notch whose frequency is 0 is none; its other two numbers are kept for when it gets one.

    Notes
    -----
    `proportional` [V/um], `integral` [V/(um s)] and `lowpass` [Hz, 0 for none] are numbers.
    `frequency` [Hz], `rejection` (the gain at it) [1] and `bandwidth` (twice the damping ratio of
    the poles) [1] are lists, one entry for each notch.

    Examples
    --------
    >>> draft = ServoDraft(ServoSettings(integral=1.9e9, notches=(Notch(frequency_hz=800.0),)))
    >>> draft.integral, draft.frequency[0], draft.rejection[0], draft.bandwidth[0]
    (1900.0, 800.0, 0.02, 1.0)
    """

    def __init__(self, settings: ServoSettings) -> None:
        self.proportional = settings.proportional * _MICRO
        self.integral = settings.integral * _MICRO
        self.lowpass = settings.lowpass_hz or 0.0
        notches = settings.notches[:NOTCHES]
        idle = NOTCHES - len(notches)
        self.frequency = [n.frequency_hz for n in notches] + [0.0] * idle
        self.rejection = [n.zero_damping / n.pole_damping for n in notches] + [0.02] * idle
        self.bandwidth = [2.0 * n.pole_damping for n in notches] + [1.0] * idle
        self._more = settings.notches[NOTCHES:]

    def settings(self) -> ServoSettings:
        """Return the settings."""
        notches = [
            Notch(frequency_hz=f, zero_damping=0.5 * r * b, pole_damping=0.5 * b)
            for f, r, b in zip(self.frequency, self.rejection, self.bandwidth, strict=True)
            if f != 0.0
        ]
        return ServoSettings(
            proportional=self.proportional / _MICRO,
            integral=self.integral / _MICRO,
            notches=(*notches, *self._more),
            lowpass_hz=self.lowpass or None,
        )
