"""Recordings of wrong drivers."""
