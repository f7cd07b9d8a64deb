"""Independent finite-element codes that answer the same questions from plain arrays."""
