"""Methods made of other methods: updates that are iterated, points that are carried from f to h."""

from collections.abc import Callable
from dataclasses import replace

from sigmapoint import checks
from sigmapoint.carry import Augmented, Carry, ExtendedSet, Redraw
from sigmapoint.methods import Method
from sigmapoint.rules.at_mean import AtMean
from sigmapoint.rules.linearization import SigmaPointRule


def iterated(method: Method, iterations: int = 3) -> Method:
    """The same filter with its measurement update iterated.

    Every pass linearises about the latest posterior and updates *from the prior*, so a measurement is counted once: the
    iterated extended Kalman filter for `ekf`, iterated posterior linearisation (García-Fernández et al. 2015) for rules
    with points. Innovations and the likelihood are those of the prediction (the first pass).

    Args:
        method: any method that redraws its points.
        iterations: number of passes; 1 is the plain filter.

    Returns:
        The method, with that number of passes.

    Raises:
        ValueError: not a method, fewer than one pass, or a method that carries points.

    Examples:
        >>> import sigmapoint as sp
        >>> sp.iterated(sp.srcdkf(), 5).iterations
        5
    """
    checks.instance("method", method, Method)
    iterations = checks.whole("iterations", iterations, 1)
    if iterations > 1 and not isinstance(method.carry, Redraw):
        raise ValueError("iterated: a method that carries one point set through f and h cannot draw a new one for h")
    return replace(method, iterations=iterations)


def augmented(method: Method) -> Method:
    """One point set for state and both noises through f and h (Wan & van der Merwe 2001, Table 7.3.1).

    For `ekf` nothing changes: a derivative at the mean has no points to carry.

    Args:
        method: any method that is not iterated.

    Returns:
        The method, with its points carried from f to h.

    Raises:
        ValueError: not a method, or an iterated one.

    Examples:
        >>> import sigmapoint as sp
        >>> sp.augmented(sp.srukf()).carry
        Augmented()
    """
    return _carrying(method, Augmented())


def extended_set(method: Method) -> Method:
    """The propagated points, extended by points for the process noise, go on through h.

    Wan & van der Merwe (2001), footnote 6 to Table 7.3.2: no second set is drawn, so odd moments that f has given the
    points reach h. For `ekf` nothing changes: a derivative at the mean has no points to carry.

    Args:
        method: any method that is not iterated.

    Returns:
        The method, with its points carried from f to h.

    Raises:
        ValueError: not a method, or an iterated one.

    Examples:
        >>> import sigmapoint as sp
        >>> sp.extended_set(sp.ukf()).carry
        ExtendedSet()
    """
    return _carrying(method, ExtendedSet())


def _carrying(method: Method, carry: Carry) -> Method:
    checks.instance("method", method, Method)
    if method.iterations > 1:
        raise ValueError("an iterated method draws new points for h; it cannot carry those of f")
    return replace(method, carry=carry) if isinstance(method.rule, SigmaPointRule) else method


def at_mean(method: Method) -> Method:
    """Predict by the value at the mean in place of the mean of the values (option 2 of parameter estimation).

    Source: Wan & van der Merwe (2001), Table 7.4.1. For problems whose error can go to zero, as in optimisation.

    Args:
        method: any method; an extended one predicts so already.

    Returns:
        The method, with such predictions.

    Raises:
        ValueError: not a method.

    Examples:
        >>> import sigmapoint as sp
        >>> sp.at_mean(sp.srukf()).rule.rule.alpha
        1.0
    """
    checks.instance("method", method, Method)
    return replace(method, rule=AtMean(method.rule)) if isinstance(method.rule, SigmaPointRule) else method


VARIANTS: dict[str, Callable[..., Method]] = {
    make.__name__: make for make in (iterated, augmented, extended_set, at_mean)
}
"""Each by its name, for the command line; the first argument is a method."""
