"""Meshes and mesh sequences as few bytes."""
