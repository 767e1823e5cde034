"""The simulated machine, at the far end of the same wires."""
