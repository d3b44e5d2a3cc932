"""`mackey-glass`: a chaotic series through noise."""
