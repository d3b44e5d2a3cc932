"""Particle filters: a cloud of weighted draws in place of a Gaussian."""
