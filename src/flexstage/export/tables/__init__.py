"""Characteristics as tables for other programs: CSV, Excel, LaTeX."""
