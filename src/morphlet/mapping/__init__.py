"""From sphere to sphere and from mesh to mesh: alignments, and the correspondences that they give."""
