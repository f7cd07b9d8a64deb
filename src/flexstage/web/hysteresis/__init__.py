"""What the view Hysteresis shows and does: its state, what is computed for it, its parts."""
