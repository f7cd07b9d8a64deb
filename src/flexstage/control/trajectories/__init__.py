"""Trajectories of one or more axes: whole periods, with round corners, that repeat smoothly."""
