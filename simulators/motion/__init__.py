"""A simulated motion controller that speaks, plans and moves as Grbl 1.1h and grblHAL do."""
