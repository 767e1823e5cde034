"""The motion controller, over a byte link."""
