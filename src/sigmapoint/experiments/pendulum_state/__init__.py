"""`pendulum-state`: half the states are seen."""
