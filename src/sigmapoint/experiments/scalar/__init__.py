"""`scalar`: a scalar model with a cubic sensor."""
