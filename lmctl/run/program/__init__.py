"""Where in its program a run is: which lines may go, and how the nozzle gets back to its path."""
