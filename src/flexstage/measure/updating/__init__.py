"""Model updating: the dimensions and the material of a stage from what was measured on it."""
