"""The view Centring: what was measured of a scale, and the moves that centre it."""
