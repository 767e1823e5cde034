"""The states of a run, and the loop that goes through them."""
