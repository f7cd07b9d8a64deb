"""Straight line: its law, its fit, and its code in C and MATLAB."""
