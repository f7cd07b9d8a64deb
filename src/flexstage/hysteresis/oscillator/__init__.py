"""A mass on a spring with Bouc-Wen hysteresis: simulated exactly, identified from records."""
