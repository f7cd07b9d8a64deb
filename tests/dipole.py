"""A dipole across the axis of a table, and the probes under it: an encoder by the field alone."""

import numpy as np

#: Angles of the table [rad].
THETA = np.arange(360) * 2.0 * np.pi / 360.0
#: Where the stage must stand for the magnet, or the probes, to be on the axis [m].
CENTRE = np.array([60e-6, -40e-6])
#: Where it stood [m].
STOOD = np.array([[0, 0], [100, 0], [0, 100], [100, 100], [-100, -50]]) * 1e-6
_GAP, _RADIUS = 2e-3, 1.5e-3
#: How far off what the stage does not move is [m].
_MAGNET_OFF, _PROBES_OFF = (30e-6, 20e-6), (50e-6, 30e-6)


def dipole_error(magnet, probes, joined):
    """Angle error [rad] of probes at a point, of two, or of four in two pairs.

    The magnet turns with the table, ``magnet`` off the axis; the probes are ``probes`` off it.
    """
    c, s = np.cos(THETA), np.sin(THETA)
    at = np.stack([c * magnet[0] - s * magnet[1], s * magnet[0] + c * magnet[1], 0 * c], axis=1)
    moment = np.stack([c, s, 0 * c], axis=1)

    def field(x, y):
        r = np.array([probes[0] + x, probes[1] + y, _GAP]) - at
        d = np.linalg.norm(r, axis=1, keepdims=True)
        return 3.0 * r * np.sum(r * moment, axis=1, keepdims=True) / d**5 - moment / d**3

    if joined == "at a point":
        b = field(0.0, 0.0)
        read = np.arctan2(-b[:, 1], -b[:, 0])
    else:
        x, y = field(_RADIUS, 0.0)[:, 2], field(0.0, _RADIUS)[:, 2]
        if joined == "four":
            x, y = x - field(-_RADIUS, 0.0)[:, 2], y - field(0.0, -_RADIUS)[:, 2]
        read = np.arctan2(y, x)
    return np.angle(np.exp(1j * (read - THETA)))


def dipole_at(position, joined, moved):
    """The same with the stage at a position, which moves the magnet or the probes."""
    off = position - CENTRE
    if moved == "magnet":
        return dipole_error(off, _PROBES_OFF, joined)
    return dipole_error(_MAGNET_OFF, off, joined)
