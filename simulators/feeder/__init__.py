"""A simulated powder feeder: hoppers with hoses, and the PMX device that drives them."""
