"""Several bodies as one (method.md 4)."""
