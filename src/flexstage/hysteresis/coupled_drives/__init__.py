"""Several drives that move several sensors: one model of all, resonances and levels included."""
