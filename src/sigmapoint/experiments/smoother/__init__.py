"""`smoother`: two-filter smoothers of noisy series."""
