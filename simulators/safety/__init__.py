"""A simulated safety-input device, and how it is wired to the rest of the cell."""
