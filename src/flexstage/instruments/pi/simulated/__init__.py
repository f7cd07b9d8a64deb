"""A simulated controller: axes, wave tables and a recorder before a stage, and its command set."""
