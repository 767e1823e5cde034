"""The job file, the waist of the hourglass: planning ends by writing one, running reads it."""
