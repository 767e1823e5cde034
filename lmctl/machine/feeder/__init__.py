"""Powder feeders."""
