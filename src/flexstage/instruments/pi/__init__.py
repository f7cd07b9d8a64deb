"""Controllers that speak PI's General Command Set, over the network, a serial port or a gateway."""
