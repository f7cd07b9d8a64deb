"""An oscillator with a Bouc-Wen force and its identification, of the public benchmark.

Evidence for the hysteresis models and the exact steps that the package has; no stage needs it.
"""
