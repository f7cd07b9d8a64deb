"""Asymmetric Bouc-Wen: its law, how it is fitted, and what it is in C and MATLAB."""
