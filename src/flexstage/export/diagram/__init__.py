"""The structural diagram of a stage: blocks and lines, laid out and drawn."""
