"""The hysteresis models, one file each, and the kernels that they share."""
