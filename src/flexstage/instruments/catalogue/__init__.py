"""The catalogue of runs, calibrations and models, on SQLite or PostgreSQL."""
