"""The stage as a device: controllers, acquisition, the twin, and what keeps them safe."""
