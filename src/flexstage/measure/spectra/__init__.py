"""Spectra of measured records: frequency responses and power spectral densities."""
