"""What must hold while a run is under way, and what is said where it does not."""
