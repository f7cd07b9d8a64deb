"""Virtual measurements of a stage: made with scatter, read with noise, and labelled as such."""
