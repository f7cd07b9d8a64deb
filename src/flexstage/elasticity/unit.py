"""The unit that meshes are made in."""

#: One metre in the unit of geometry and mesh, the millimetre: the tolerances of the geometry
#: kernel are absolute, and made for it. Everything else is SI.
METRE = 1e3
