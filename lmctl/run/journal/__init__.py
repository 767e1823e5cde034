"""What is kept of runs and of machines, and what it proves afterwards."""
