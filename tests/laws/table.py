"""The table of methods that every law is held against: `METHODS` of the library, and other settings of some of them."""

import sigmapoint as sp
from sigmapoint.methods import METHODS as BY_NAME

OTHER_SETTINGS = {
    "ukf(1e-3)": (sp.ukf(alpha=1e-3), sp.srukf(alpha=1e-3)),
    "ukf(1,0,2)": (sp.ukf(1.0, 0.0, 2.0), sp.srukf(1.0, 0.0, 2.0)),
    "simplex_ukf(n+2)": (sp.simplex_ukf(w0=0.3), sp.srsimplex_ukf(w0=0.3)),
    "extended set": (sp.extended_set(sp.ukf()), sp.extended_set(sp.srukf())),
    "augmented": (sp.augmented(sp.cdkf()), sp.augmented(sp.srcdkf())),
}
PAIRS = {
    name: (make(), BY_NAME[f"sr{name}"]()) for name, make in BY_NAME.items() if not name.startswith("sr")
} | OTHER_SETTINGS
"""Dense and square-root form of every method."""
DENSE = {name: pair[0] for name, pair in PAIRS.items()}
SQUARE_ROOT = {f"sr {name}": pair[1] for name, pair in PAIRS.items()}
METHODS = DENSE | SQUARE_ROOT
LARGEST = {"ghkf": 5, "sr ghkf": 5}
"""The largest dimension in which a method is tried: a product rule has 3ⁿ points."""


def precision(name: str) -> float:
    """Relative agreement to ask for: at alpha = 1e-3 differences come from values that share three more digits."""
    return 1e-6 if "1e-3" in name else 1e-10
