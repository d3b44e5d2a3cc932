"""`upf-synthetic`: proposals of Kalman filters."""
