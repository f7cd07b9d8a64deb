"""The catalogue of runs, calibrations and models, in any database that SQLAlchemy reaches."""
