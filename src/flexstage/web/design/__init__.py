"""What the view Design shows and does: its state, what is computed for it, its parts."""
