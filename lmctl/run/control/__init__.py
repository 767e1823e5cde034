"""What an operator asks of a run from another terminal."""
