"""A closed genus-0 mesh laid one-to-one on the unit sphere, and what that map is good for."""
