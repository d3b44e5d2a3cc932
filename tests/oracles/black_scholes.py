"""Prices of European options as discounted expectations of what they pay, by quadrature; 50 digits."""

import mpmath


def price(pays, rate, volatility, moneyness, maturity):
    """`pays(s)` of the index over strike at maturity, which is log-normal under the risk-neutral measure."""
    with mpmath.workdps(50):
        r, sigma, m, t = map(mpmath.mpf, (rate, volatility, moneyness, maturity))
        spread = sigma * mpmath.sqrt(t)
        kink = (-mpmath.log(m) - (r - sigma**2 / 2) * t) / spread  # where the index ends at the strike

        def discounted(z):
            return mpmath.exp(-r * t) * pays(m * mpmath.exp((r - sigma**2 / 2) * t + spread * z)) * mpmath.npdf(z)

        ends = sorted({mpmath.mpf(-16), mpmath.mpf(0), mpmath.mpf(16), max(min(kink, mpmath.mpf(16)), mpmath.mpf(-16))})
        return mpmath.quad(discounted, ends)


def call(*args):
    """Over its strike."""
    return price(lambda s: max(s - 1, 0), *args)


def put(*args):
    """Over its strike."""
    return price(lambda s: max(1 - s, 0), *args)
