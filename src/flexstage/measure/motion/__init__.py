"""Figures of the motion of a stage over its stroke, from measured columns.

`motion_cycles` cuts a record into cycles; `fit_motion_curve` makes of them a `MotionCurve`, a
reading over the stroke, forward and backward, drift and offsets apart. From curves come `stroke`
and, by `curve_range`, the ranges of errors and rotations; from points the motion of a rigid body;
from repeated targets, as `visits` or `staircase_dwells` sort them, `positioning`, and from its four
corners the `workspace`.
"""
