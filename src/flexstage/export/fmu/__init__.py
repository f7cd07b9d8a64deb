"""A stage as an FMU of FMI 2.0 or 3.0: co-simulation and model exchange in one file."""
