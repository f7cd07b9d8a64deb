"""A stage that runs sample by sample, with hysteresis, creep, noise and scatter as it has them."""
