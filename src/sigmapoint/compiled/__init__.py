"""How functions and loops over series are put, so that XLA makes fast programs of them."""
