"""Numbers: linear solves, rotations, optimisation, exact signs, the unit sphere. Nothing here knows a mesh."""
