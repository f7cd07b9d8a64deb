"""The model as C: hysteresis, modes, amplifier, creep and sensor, without libraries."""
