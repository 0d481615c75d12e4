"""Files: triangle meshes in their own vertex indexing, sequences of them, marker files."""
