"""The view Centring: turns of a scale, and the moves that centre it."""
