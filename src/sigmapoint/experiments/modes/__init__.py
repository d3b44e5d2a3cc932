"""`modes`: natural frequencies of two masses."""
