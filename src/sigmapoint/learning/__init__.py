"""Parameters of any function from pairs of inputs and targets."""
