"""Powder on time: what the hoppers are told now for what the path needs later."""
