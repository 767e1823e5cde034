"""Several bodies as one (docs/explanation/multi-colour-distance-field.md, Booleans)."""
