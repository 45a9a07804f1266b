"""Shapes of objects."""
