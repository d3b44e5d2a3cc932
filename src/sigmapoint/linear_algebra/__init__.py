"""Factors of covariances: triangularised, multiplied, solved with, derived."""
