"""What the view Explore shows and does: forms, what is computed for them, points, charts."""
