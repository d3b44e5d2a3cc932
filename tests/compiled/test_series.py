"""A loop in chunks is the loop: forward and backward, where the rows fill the last chunk and where they do not."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from sigmapoint.compiled import series


def step(state, row):
    after = 0.9 * state + jnp.sin(row["u"]) * row["gain"]
    return after, (after, 2.0 * state)


def rows(T):
    return {"u": jnp.arange(float(T)), "gain": jnp.linspace(1.0, 2.0, T)}


@pytest.fixture
def in_chunks_of_seven(monkeypatch):
    monkeypatch.setattr(series, "NATIVE", True)
    monkeypatch.setattr(series, "SMALL", 2 * 7 * 4 * 8)  # rows and outputs have four numbers of eight bytes


@pytest.mark.usefixtures("in_chunks_of_seven")
@pytest.mark.parametrize("reverse", [False, True])
@pytest.mark.parametrize("T", [1, 2, 6, 7, 8, 13, 14, 29, 100])
def test_chunks_change_nothing(T, reverse):
    got = series.scan(step, jnp.float64(1.0), rows(T), reverse=reverse)
    expected = jax.lax.scan(step, jnp.float64(1.0), rows(T), reverse=reverse)
    jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, rtol=1e-15), got, expected)


@pytest.mark.usefixtures("in_chunks_of_seven")
def test_rows_that_fill_a_chunk_reach_neither_state_nor_derivative():
    """The state blows up if it is stepped once too often."""

    def reciprocal(state, row):
        return state - row, 1 / state

    def total(start):
        return series.scan(reciprocal, start, jnp.ones(29))[0]

    assert total(jnp.float64(29.0)) == 0
    assert jax.grad(total)(jnp.float64(29.0)) == 1
    lowered = jax.jit(total).lower(jnp.float64(29.0)).as_text()
    assert lowered.count("stablehlo.while") == 2
