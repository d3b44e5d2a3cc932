"""Methods by name: each is one expression, a rule with a kind of belief.

| method | rule | points in n dimensions |
|---|---|---|
| `ekf` | first-order Taylor | 1, and n derivatives |
| `ukf` | scaled unscented | 2n+1 |
| `julier_ukf` | unscented, free centre weight | 2n+1 |
| `simplex_ukf` | reduced simplex | n+2 (the centre may have no weight) |
| `cdkf` | central differences | 2n+1 |
| `ckf` | cubature | 2n+1 (the centre has no weight) |
| `ssckf` | cubature on a simplex and its mirror image | 2n+3 (the centre has no weight) |
| `ghkf` | Gauss-Hermite product | orderⁿ |

Those with `sr` before the name carry a square root of the covariance in place of the covariance.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

from sigmapoint import checks
from sigmapoint.belief import Dense, SquareRoot
from sigmapoint.rules.central import CentralDifference
from sigmapoint.rules.cubature import Cubature
from sigmapoint.rules.hermite import GaussHermite
from sigmapoint.rules.simplex import Simplex
from sigmapoint.rules.spherical_simplex import SphericalSimplex
from sigmapoint.rules.taylor import Taylor
from sigmapoint.rules.unscented import Julier, Unscented
from sigmapoint.step import Method


def gaussian_filter(name: str, given: Any, default: Method | None = None) -> Method:
    """A Gaussian filter as an argument, or its default.

    Raises:
        ValueError: anything else.
    """
    method: Any = default if given is None else given
    checks.instance(name, method, Method, "a sp.Method, a Gaussian filter such as sp.srukf()")
    return method


def _numbers(**settings: Any) -> dict[str, float]:
    return {name: checks.number(name, value) for name, value in settings.items()}


def ekf() -> Method:
    """Extended Kalman filter: first-order Taylor (Wan & van der Merwe 2001, Table 7.2.1).

    Derivatives are taken by JAX, or are the model's own (`dynamics_jacobian`, `observation_jacobian`).

    Examples:
        >>> import sigmapoint as sp
        >>> sp.ekf().rule
        Taylor()
    """
    return Method(Taylor(), Dense)


def srekf() -> Method:
    """Extended Kalman filter on a square root of the covariance."""
    return Method(Taylor(), SquareRoot)


def ukf(alpha: float = 1.0, beta: float = 2.0, kappa: float = 0.0) -> Method:
    """Unscented Kalman filter (Wan & van der Merwe 2001, Table 7.3.2).

    Args:
        alpha: spread of the points, relative; small values (1e-3) look only near the mean, and lose digits in float32
            (a warning says so).
        beta: knowledge of the prior's tails; 2 is best for Gaussians.
        kappa: secondary spread; 0, or 3 − n.

    Raises:
        ValueError: settings whose covariance can lose positive definiteness.

    Examples:
        >>> import sigmapoint as sp
        >>> sp.ukf(alpha=1e-3).rule.kappa
        0.0
    """
    return Method(Unscented(**_numbers(alpha=alpha, beta=beta, kappa=kappa)), Dense)


def srukf(alpha: float = 1.0, beta: float = 2.0, kappa: float = 0.0) -> Method:
    """Square-root unscented Kalman filter; arguments as `ukf`. No downdate: it cannot fail to factor."""
    return replace(ukf(alpha, beta, kappa), belief=SquareRoot)


def julier_ukf(w0: float = 1 / 3) -> Method:
    """Unscented filter whose centre point has a weight of its own (Julier & Uhlmann 1997; κ = n w0 / (1 − w0)).

    Args:
        w0: weight of the centre, in [0, 1); 1/3 puts the points √(3n/2) out.

    Raises:
        ValueError: a weight outside [0, 1).

    Examples:
        >>> import sigmapoint as sp
        >>> sp.julier_ukf(0.5).rule
        Julier(w0=0.5)
    """
    return Method(Julier(**_numbers(w0=w0)), Dense)


def srjulier_ukf(w0: float = 1 / 3) -> Method:
    """`julier_ukf` on a square root of the covariance."""
    return replace(julier_ukf(w0), belief=SquareRoot)


def simplex_ukf(alpha: float = 1.0, beta: float = 1.0, w0: float = 0.0) -> Method:
    """Unscented filter on the fewest points, n+1 and the centre (Julier 2003); means to second degree only.

    Args:
        alpha: spread of the points, relative.
        beta: knowledge of the prior's tails.
        w0: weight of the centre, in [0, 1).

    Raises:
        ValueError: settings whose covariance can lose positive definiteness.

    Examples:
        >>> import sigmapoint as sp
        >>> sp.simplex_ukf().rule
        Simplex(alpha=1.0, beta=1.0, w0=0.0)
    """
    return Method(Simplex(**_numbers(alpha=alpha, beta=beta, w0=w0)), Dense)


def srsimplex_ukf(alpha: float = 1.0, beta: float = 1.0, w0: float = 0.0) -> Method:
    """`simplex_ukf` on a square root of the covariance."""
    return replace(simplex_ukf(alpha, beta, w0), belief=SquareRoot)


def cdkf(h: float = 3**0.5) -> Method:
    """Central difference Kalman filter (Nørgaard, Poulsen & Ravn 2000; van der Merwe & Wan 2001).

    Args:
        h: interval of the differences in standard deviations; h² = 3, the kurtosis, suits Gaussians.

    Raises:
        ValueError: an interval below 1.

    Examples:
        >>> import sigmapoint as sp
        >>> sp.cdkf().rule
        CentralDifference(h=1.7320508075688772)
    """
    return Method(CentralDifference(**_numbers(h=h)), Dense)


def srcdkf(h: float = 3**0.5) -> Method:
    """Square-root central difference Kalman filter; the recommended default."""
    return replace(cdkf(h), belief=SquareRoot)


def ckf() -> Method:
    """Cubature Kalman filter (Arasaratnam & Haykin 2009): the unscented filter with α = 1, β = κ = 0."""
    return Method(Cubature(), Dense)


def srckf() -> Method:
    """Square-root cubature Kalman filter."""
    return Method(Cubature(), SquareRoot)


def ssckf() -> Method:
    """Spherical simplex-radial cubature (Wang, Feng & Tse 2014): as exact as `ckf`, and sees states multiplied."""
    return Method(SphericalSimplex(), Dense)


def srssckf() -> Method:
    """Square-root spherical simplex-radial cubature Kalman filter."""
    return Method(SphericalSimplex(), SquareRoot)


def ghkf(order: int = 3) -> Method:
    """Gauss-Hermite Kalman filter: `order`ⁿ points, for few states (Ito & Xiong 2000).

    Args:
        order: points an axis; exact for polynomials up to degree 2·order − 1.

    Raises:
        ValueError: an order below 2; when a model is filtered, more points than memory is for.

    Examples:
        >>> import sigmapoint as sp
        >>> sp.ghkf(5).rule
        GaussHermite(order=5)
    """
    return Method(GaussHermite(checks.whole("order", order, 2)), Dense)


def srghkf(order: int = 3) -> Method:
    """Square-root Gauss-Hermite Kalman filter."""
    return Method(GaussHermite(checks.whole("order", order, 2)), SquareRoot)


METHODS: dict[str, Callable[..., Method]] = {
    make.__name__: make
    for make in (
        *(ekf, srekf, ukf, srukf, julier_ukf, srjulier_ukf, simplex_ukf, srsimplex_ukf),
        *(cdkf, srcdkf, ckf, srckf, ssckf, srssckf, ghkf, srghkf),
    )
}
"""Every method by its name, for the command line and for tables; each can be made without arguments."""
