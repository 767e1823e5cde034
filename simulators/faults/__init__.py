"""Faults on demand: what can go wrong with a cell, as data, and what makes it go wrong."""
