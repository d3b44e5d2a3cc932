"""`dual-ar` and `dual-mackey-glass`: noisy series and their unknown networks."""
