"""The linear chain between a command and a reading: each element simulated, and undone."""
