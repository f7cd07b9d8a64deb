"""Natural frequencies, damping and mode shapes from frequency responses and free decays."""
