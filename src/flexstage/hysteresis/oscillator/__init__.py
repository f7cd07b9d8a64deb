"""An oscillator with a Bouc–Wen force in its loop, and its identification from records."""
