"""Gaussian-sum filters: a mixture of Gaussians as belief."""
