"""Errors of the user's own functions come out as they are, and say what the function was called with."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from test_bad_input import EYE2, model, run

import sigmapoint as sp


def test_a_model_that_computes_with_numpy_is_told_what_to_write():
    with pytest.raises(jax.errors.TracerArrayConversionError) as error:
        run(dynamics=lambda x, u: np.sin(x))
    assert "write jnp.sin for np.sin" in error.value.__notes__[0]


def test_a_model_is_told_which_input_is_missing():
    with pytest.raises(TypeError, match="NoneType") as error:
        run(dynamics=lambda x, u: x + u["push"])
    assert "dynamics was called with u=None: pass u=" in error.value.__notes__[0]
    with pytest.raises(KeyError, match="tq") as error:
        run(u={"torque": np.ones(5)}, dynamics=lambda x, u: x + u["tq"])
    assert "dynamics was called with a u that has the keys 'torque'" in error.value.__notes__[0]


@pytest.mark.parametrize(
    ("broken", "kind", "u"),
    [(lambda x: x, TypeError, None), (lambda x, u: jnp.stack([x[0], u["a"]]), ValueError, {"a": np.ones((5, 1))})],
)
def test_what_a_function_was_called_with_is_said_where_it_fails(broken, kind, u):
    with pytest.raises(kind) as error:
        run(u=u, dynamics=broken)
    given = "u None" if u is None else "u {'a': (1,)}"
    assert f"dynamics was called with x (2,), {given}" in error.value.__notes__


def test_a_misspelt_parameter_is_told_the_names_there_are():
    with pytest.raises(KeyError, match="q") as error:
        sp.fit(lambda theta: model(process_noise=theta["q"] * EYE2), {"Q": 1.0}, np.ones((3, 1)))
    assert "build was called with a theta that has the keys 'Q'" in error.value.__notes__[0]


def test_a_failing_model_keeps_its_own_error():
    def broken(x, u):
        raise KeyError("no such table")

    with pytest.raises(KeyError, match="no such table"):
        run(dynamics=broken)
