"""`rosenbrock`: a curved valley."""
