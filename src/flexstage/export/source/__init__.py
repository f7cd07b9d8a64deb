"""The dynamic model as C source: hysteresis, modes, amplifier, creep and sensor."""
