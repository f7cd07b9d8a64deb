"""What every room needs and which needs none: version, errors, progress, provenance, arrays."""
