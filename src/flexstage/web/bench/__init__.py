"""The view Bench: the link to a stage, who drives it, what is done with it."""
