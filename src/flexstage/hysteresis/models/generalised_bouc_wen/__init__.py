"""Generalised Bouc-Wen model: its law, its fit, and its code in C and MATLAB."""
