"""`pendulum-adaptive`: held upright while its masses are learned."""
