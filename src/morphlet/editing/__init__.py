"""Pull some vertices of a mesh, keep others, let the rest follow."""
