"""What is done to a machine outside a run: looked at, homed, jogged."""
