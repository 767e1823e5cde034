"""From triangles to a field."""
