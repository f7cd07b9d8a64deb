"""What the view Analyse shows and does: its state, what is computed for it, its parts."""
