"""The structural diagram of a stage: its equations as blocks and lines, and drawn."""
