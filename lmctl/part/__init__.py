"""A part answers two questions: what is solid and how deep, and of what."""
