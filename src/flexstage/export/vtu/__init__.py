"""Statics and modes as files of the Visualization Toolkit, for ParaView and its like."""
