"""Networks that learn: `robot-arm`, `four-regions`, `ikeda`, `mackey-glass-learning`."""
