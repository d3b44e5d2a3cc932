"""`cost`: operations and times of an update."""
