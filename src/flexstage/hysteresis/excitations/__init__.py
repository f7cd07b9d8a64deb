"""Design of experiments: drive records for the identification of a stage, within its limits."""
