"""Foundations that import no other room: version, errors, progress, provenance, arrays."""
