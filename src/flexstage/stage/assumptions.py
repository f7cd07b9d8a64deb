"""Assumed properties of a stage, its drives, sensors and table, in the absence of measurements.

Every simulation and export uses these figures. The description of a stage, or its published
measured rows, takes precedence. A figure without a source is typical of such parts, and not a
measurement.
"""

#: Width of a stack's loop over its stroke [1]: data sheets of stacks under voltage control state
#: 10 to 15 %.
LOOP_WIDTH = 0.125
#: Creep of a stack in a decade of time [1].
CREEP = 0.012
#: Bandwidth of a stack's amplifier [Hz], and its largest current [A].
AMPLIFIER_BANDWIDTH_HZ, AMPLIFIER_CURRENT = 2000.0, 0.3
#: Voltage of a stack without a range [V].
VOLTAGE_RANGE = (0.0, 120.0)
#: Bits of the converter in a fast loop, and of that of a slow command.
LOOP_CONVERTER_BITS, CONVERTER_BITS = 20, 16
#: Play of a screw on turning back, as its advance [m].
BACKLASH = 0.5e-6

#: Damping ratio of the modes in a model [1], typical of a bolted monolithic aluminium stage; and in
#: a virtual stage, where it differs a little.
DAMPING_RATIO, VIRTUAL_DAMPING_RATIO = 0.01, 0.0087
#: Over the stroke [1]: straightness where no model gives it; scatter of the position from cycle to
#: cycle; reversal value.
STRAIGHTNESS, REPEATABILITY, REVERSAL = 2e-3, 1.5e-4, 5e-4
#: Length over which an error of straightness, or drift, is a rotation [m].
GUIDE_LENGTH = 50e-3
#: Spread of the direction of a path about the one that the model gives [rad].
DIRECTION_SPREAD = 2e-4
#: Spread of strokes, of widths of loops and of backlash from one stage to the next [1].
STROKE_SPREAD, LOOP_WIDTH_SPREAD, BACKLASH_SPREAD = 0.02, 0.04, 0.2

#: Rms noise of capacitive sensors along an axis and across it [m], of an autocollimator [rad], in a
#: quiet room, and of eddy-current sensors [m].
POSITION_NOISE, TRANSVERSE_NOISE, ANGLE_NOISE, EDDY_CURRENT_NOISE = 5e-9, 3e-9, 5e-8, 20e-9
#: Standard deviation of the settled position of an axis about its target [m].
SETTLING = 2e-9
#: Orders of the error motion of a table that are no whole multiples of its turns: typical rates of
#: a cage with its balls.
ASYNCHRONOUS_ORDERS = (0.43, 2.57, 5.43)
