"""What is characteristic of a place on a mesh."""
