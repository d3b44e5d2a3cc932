"""Pages, claims and rows of experiments, and several experiments at a time."""
