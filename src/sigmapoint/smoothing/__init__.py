"""Looking back: each state from measurements after it too."""
