"""`pendulum-parameters`: lengths and masses from falls."""
