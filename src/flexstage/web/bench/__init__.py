"""The view Bench: connection to a stage, control, commands and runs."""
