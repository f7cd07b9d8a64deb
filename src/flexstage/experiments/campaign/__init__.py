"""A set of tests: their description, and the figures that their records give."""
