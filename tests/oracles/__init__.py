"""Textbook filters in plain NumPy and mpmath, written from the papers and never from `sigmapoint`.

Conventions, shared by every file:

* Row k of `y` and `u`, and `Q[k]`, `R[k]` where they vary, belong to instant k; `Q[k]` drives x[k] -> x[k+1].
* `first="update"`: (m0, P0) is the belief about x[0] before y[0]; update with y[0], predict, update with y[1], ...
* `first="predict"`: (m0, P0) is the posterior about x[0]; row i of `y` and of the results is instant i + 1 (the papers'
  "for k in 1, 2, ..."), while `u`, `Q`, `R` keep their instants, so `u` has one row more than `y`.
* A NaN element of `y` was not measured: its row is dropped from the innovation and from its covariance.
"""
