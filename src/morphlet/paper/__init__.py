"""Every table and figure of the paper, computed, with what the paper left out filled in and what it got wrong said."""
