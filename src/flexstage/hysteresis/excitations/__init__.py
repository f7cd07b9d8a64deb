"""The design of the experiment: a drive record that identifies a stage, within its limits."""
