"""Version of flexstage, apart from all other modules, so that it can be read without them."""

__version__ = "0.1.0"
