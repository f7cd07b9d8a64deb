"""Recording to disk: streams that survive a crash, and the folders of runs."""
