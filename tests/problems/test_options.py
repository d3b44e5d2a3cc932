"""Options: prices against quadrature, limits and derivatives; the simulated market; the loader and its messages."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracles import black_scholes
from scipy.special import ndtr

import sigmapoint as sp
from sigmapoint.problems import options, options_market
from sigmapoint.problems.options import Quote
from sigmapoint.problems.options_data import ftse100

CASES = [
    (0.05, 0.2, 1.0, 1.0),
    (0.01, 0.15, 1.19, 0.85),
    (0.0, 0.5, 0.7, 0.1),
    (-0.02, 0.1, 1.05, 0.02),
    (0.1, 0.05, 0.95, 2.0),
]


@pytest.mark.parametrize("case", CASES)
def test_prices_are_the_discounted_expectations_of_what_options_pay(case):
    rate, volatility, moneyness, maturity = case
    quote = Quote(moneyness, maturity)
    # Differences of two terms of order 1: absolute, a few units in the last place.
    np.testing.assert_allclose(options.call(rate, volatility, quote), float(black_scholes.call(*case)), atol=1e-15)
    np.testing.assert_allclose(options.put(rate, volatility, quote), float(black_scholes.put(*case)), atol=1e-15)


def test_call_minus_put_is_index_minus_discounted_strike():
    grid = np.meshgrid([-0.02, 0.1], [0.0, 0.01, 0.8], [0.3, 1.0, 3.0], [0.0, 1e-9, 2.0])
    rate, volatility, moneyness, maturity = map(jnp.asarray, grid)
    quote = Quote(moneyness, maturity)
    parity = options.call(rate, volatility, quote) - options.put(rate, volatility, quote)
    np.testing.assert_allclose(parity, moneyness - np.exp(-rate * maturity), atol=1e-15)


@pytest.mark.parametrize("dtype", [jnp.float32, jnp.float64])
def test_at_maturity_and_without_volatility_prices_are_their_limits(dtype):
    flat = [(0.0, 0.5), (0.2, 0.0), (0.0, 0.0), (1e-30, 1e-30)]
    cases = np.array([(0.05, sigma, m, t) for sigma, t in flat for m in (0.9, 1.0, 1.1)])
    worth = cases[:, 2] - np.exp(-0.05 * cases[:, 3])

    def of(case):
        price = partial(options.prices, u=Quote(case[2], case[3]))
        return price(case[:2]), jax.jacobian(price)(case[:2]), jax.hessian(price)(case[:2])

    found, *derivatives = jax.jit(jax.vmap(of))(jnp.asarray(cases, dtype))
    assert found.dtype == dtype
    limits = np.stack([np.maximum(worth, 0), np.maximum(-worth, 0)], axis=1)
    np.testing.assert_allclose(found, limits, atol=4 * float(jnp.finfo(dtype).eps))
    assert all(jnp.isfinite(each).all() for each in derivatives)


@pytest.mark.parametrize("case", CASES)
def test_derivatives_are_rho_and_vega(case):
    r, sigma, m, t = case
    d1 = (np.log(m) + (r + sigma**2 / 2) * t) / (sigma * np.sqrt(t))
    d2 = d1 - sigma * np.sqrt(t)
    vega = m * np.exp(-(d1**2) / 2) / np.sqrt(2 * np.pi) * np.sqrt(t)
    worth = t * np.exp(-r * t)
    expected = [[worth * ndtr(d2), vega], [-worth * ndtr(-d2), vega]]
    found = jax.jacobian(options.prices)(jnp.array([r, sigma]), Quote(jnp.array(m), jnp.array(t)))
    np.testing.assert_allclose(found, expected, rtol=1e-11, atol=1e-14)


def test_no_negative_volatility_explains_prices():
    quote = Quote(jnp.array(1.05), jnp.array(0.4))
    plus, minus = (options.prices(jnp.array([0.03, sigma]), quote) for sigma in (0.2, -0.2))
    np.testing.assert_allclose(minus, -plus[::-1], rtol=1e-13)
    assert (minus < 0).all()


def test_prices_without_noise_give_rate_and_volatility_back():
    market, _ = options_market.simulated(jax.random.key(0), 60)
    quote = market.quote(3225)
    true = jnp.array([0.04, 0.18])
    y = jax.vmap(options.prices, (None, 0))(true, quote)
    exact = options.model(options.Noise(rate=1e-12, volatility=1e-12, price=1e-12))
    for method in (sp.ekf(), sp.ukf()):
        np.testing.assert_allclose(sp.filter(exact, y, quote, method=method).mean[-1], true, atol=1e-5)


def test_a_simulated_market_is_priced_at_its_own_volatilities_with_the_noise_it_says():
    market, truth = options_market.simulated(jax.random.key(1))
    assert market.spot.shape == (options_market.DAYS,)
    assert market.maturity[0] == pytest.approx(223 / 260)
    assert (truth.volatility > 0).all()
    off = []
    for k, strike in enumerate(market.strikes):
        x = jnp.stack([jnp.asarray(truth.rate), jnp.asarray(truth.volatility[:, k])], axis=1)
        exact = np.asarray(jax.vmap(options.prices)(x, market.quote(strike)))
        seen = exact > 4 * options_market.PRICE_NOISE  # those near zero are cut off there
        off.append((np.asarray(market.prices(strike)) - exact)[seen])
    off = np.concatenate(off)
    np.testing.assert_allclose(off.std(), options_market.PRICE_NOISE, rtol=4 / (2 * off.size) ** 0.5)
    assert min(market.call.min(), market.put.min()) >= 0


def test_simulated_markets_have_the_index_and_the_smile_they_say():
    steps, volatility = [], []
    for key in jax.random.split(jax.random.key(2), 20):
        market, truth = options_market.simulated(key, 100)
        steps.append(np.diff(np.log(market.spot)))
        at_the_money = truth.volatility / options_market.smile(
            jnp.ones((100, 5)), jnp.asarray(market.spot[:, None] / np.array(market.strikes))
        )
        np.testing.assert_allclose(at_the_money, np.tile(at_the_money[:, :1], 5), rtol=1e-12)
        volatility.append(np.asarray(at_the_money[1:, 0]))
    scaled = np.concatenate(steps) / np.concatenate(volatility) * options_market.YEAR**0.5
    np.testing.assert_allclose(scaled.std(), 1, rtol=4 / (2 * scaled.size) ** 0.5)
    k = jnp.array([-0.1, 0.0, 0.1])
    low, middle, high = options_market.smile(jnp.array(0.2), jnp.exp(-k))
    np.testing.assert_allclose([low, middle, high], [0.2 * 1.14, 0.2, 0.2 * 0.94], rtol=1e-12)


def test_a_market_is_the_same_for_the_same_key_and_ends_at_maturity():
    one, other = (options_market.simulated(jax.random.key(3), 5)[0] for _ in range(2))
    np.testing.assert_array_equal(one.call, other.call)
    assert options_market.maturity(options_market.FINAL)[-1] == 0
    with pytest.raises(ValueError, match="days must be 1 to 224"):
        options_market.simulated(jax.random.key(0), 225)


@pytest.fixture
def folder(tmp_path):
    """Files as the loader wants them, of a simulated market; three with tabs."""
    market, _ = options_market.simulated(jax.random.key(0), 10)
    for kind, prices in (("c", market.call), ("p", market.put)):
        for k, strike in enumerate(market.strikes):
            between = "\t" if f"{kind}{strike}" in ("c3025", "c3125", "p3025") else "    "
            rows = zip(34366 + np.arange(10), prices[:, k], market.spot)
            text = "\n".join(between.join(repr(float(v)) for v in row) for row in rows)
            (tmp_path / f"{kind}{strike}.prn").write_text(text)
    return tmp_path


def test_files_are_read_back_with_their_dates(folder):
    market, _ = options_market.simulated(jax.random.key(0), 10)
    found = ftse100(folder)
    for name in ("call", "put", "spot", "maturity"):
        np.testing.assert_array_equal(getattr(found, name), getattr(market, name))
    assert found.dates[0] == np.datetime64("1994-02-01")
    assert found.until(4).dates[-1] == np.datetime64("1994-02-04")


def row(k, text):
    """Replaces a row, counted from 1."""
    return lambda content: "\n".join(text if i == k - 1 else line for i, line in enumerate(content.split("\n")))


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (lambda content: "", "p3125.prn is empty"),
        (row(3, "34368 x 3200"), "p3125.prn is not a table of numbers day, price, index"),
        (row(3, "34368 5 3200 7"), "p3125.prn is not a table of numbers day, price, index"),
        (lambda content: "\n".join(line.rsplit(maxsplit=1)[0] for line in content.split("\n")), "has 2 columns"),
        (row(3, "34368 nan 3200"), "p3125.prn: row 3 needs three finite numbers"),
        (row(3, "34368 5"), "p3125.prn: row 3 needs three finite numbers"),
        (row(3, "34368 -1 3200"), "p3125.prn: row 3 has a price below zero"),
        (row(3, "34368 5 0"), "p3125.prn: row 3 has an index of zero or less"),
        (row(3, "34367 5 3200"), "p3125.prn: row 3 is of no later day than the row before"),
        (row(10, "34376 5 3200"), "p3125.prn: row 10 has another day than c2925.prn"),
        (row(3, "34368 5 3200"), "p3125.prn: row 3 has another index than c2925.prn"),
        (lambda content: content.rsplit("\n", 1)[0], "p3125.prn has 9 rows, c2925.prn has 10"),
    ],
)
def test_what_is_wrong_with_a_file_is_said(folder, spoil, said):
    path = folder / "p3125.prn"
    path.write_text(spoil(path.read_text()))
    with pytest.raises(ValueError, match=said.replace(".", r"\.")):
        ftse100(folder)


def test_what_is_missing_is_named(folder):
    with pytest.raises(FileNotFoundError, match=r"absent is not a folder; name the one with the c and p files"):
        ftse100(folder / "absent")
    (folder / "p3325.prn").unlink()
    with pytest.raises(FileNotFoundError, match=r"p3325\.prn: no such file; the folder must hold c and p files"):
        ftse100(folder)
