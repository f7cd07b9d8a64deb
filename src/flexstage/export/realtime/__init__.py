"""A stage for a real-time target: one header of C, an example, and samples to check it with."""
