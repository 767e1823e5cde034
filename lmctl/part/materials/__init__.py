"""Of what a part is."""
