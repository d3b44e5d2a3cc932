"""`battery-joint`: capacity and resistance of a real cell."""
