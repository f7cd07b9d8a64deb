"""The view Report: what was written, and how it is written."""
