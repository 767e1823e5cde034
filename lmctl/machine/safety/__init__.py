"""The safety-input device and its laser-enable output."""
