"""From measured records to the figures of a stage, each with its uncertainty."""
