"""A stage as an FMU of FMI 2.0 or 3.0: co-simulation and model exchange in one file."""

from flexstage.export.fmu.fmu_file import fmu_files

__all__ = ["fmu_files"]
