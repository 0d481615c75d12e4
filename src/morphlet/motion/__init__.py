"""From shape to shape in time."""
