"""A stage from a drawing of its contours: bodies and necks by geometry alone."""
