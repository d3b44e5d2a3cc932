"""`f15`: a flight simulator as the model."""
