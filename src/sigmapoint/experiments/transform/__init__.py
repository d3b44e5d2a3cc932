"""`transform`: mean and covariance through a nonlinearity."""
