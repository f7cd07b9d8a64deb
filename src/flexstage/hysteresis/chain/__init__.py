"""Elements of the linear chain between a command and a reading, and their inverses."""
