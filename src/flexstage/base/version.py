"""The version of flexstage, on the ground: whoever writes it needs nothing of the package."""

__version__ = "0.1.0"
