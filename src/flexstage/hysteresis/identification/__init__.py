"""From measured records to a model of the drive: hysteresis, lag, creep and resonance."""
