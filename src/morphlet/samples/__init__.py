"""Meshes to try things on: procedural creatures with known correspondences, and a catalogue of public models."""
