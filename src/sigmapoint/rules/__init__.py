"""Rules: each answers one question, how `g(ξ)` with `ξ ~ N(0, I)` looks as `ȳ + Φ ξ + E ε`. One file each."""
