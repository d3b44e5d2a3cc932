"""Print what eighteen orders of magnitude between prior and noise (tests/laws/ill_conditioned.py) do to every method.

    python scripts/ill_conditioned.py

The number is the largest relative error of a standard deviation against 60-digit arithmetic; `broken` stands where a
covariance is not finite or not positive semi-definite.
"""

import sys
from pathlib import Path

import jax
import jax.numpy as jnp

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from laws import ill_conditioned
from laws.table import PAIRS

COLUMNS = [(dtype, coupled, m) for dtype in (jnp.float64, jnp.float32) for coupled in (False, True) for m in (1, 2, 3)]


def main() -> None:
    """One row for each form of each method, the square root before the dense form."""
    jax.config.update("jax_enable_x64", True)
    heads = ["", *(jnp.dtype(dtype).name if not coupled and m == 1 else "" for dtype, coupled, m in COLUMNS)]
    print(_line(heads))
    print(_line(["", *(("coupled" if coupled else "uncoupled") if m == 1 else "" for _, coupled, m in COLUMNS)]))
    print(_line(["method", *(f"m = {m}" for *_, m in COLUMNS)]), flush=True)
    for name, (dense, root) in PAIRS.items():
        for row, method in ((f"sr {name}", root), (name, dense)):
            print(_line([row, *(_error(method, *column) for column in COLUMNS)]), flush=True)


def _error(method, dtype, coupled: bool, m: int) -> str:
    case = ill_conditioned.case(m, coupled)
    post = ill_conditioned.filtered(case, method, dtype)
    return f"{ill_conditioned.worst(post, case.exact):.0e}" if ill_conditioned.sound(post) else "broken"


def _line(cells: list[str]) -> str:
    return f"{cells[0]:<20}" + "".join(f"{cell:>10}" for cell in cells[1:])


if __name__ == "__main__":
    main()
