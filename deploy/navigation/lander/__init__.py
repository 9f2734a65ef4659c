"""Terrain-relative navigation of a lunar lander against a selenograph service."""
