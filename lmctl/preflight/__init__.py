"""Job against machine profile: hoppers, limits, travel. Planning and running both ask it."""
