"""`options`: interest rate and volatility from prices of options."""
