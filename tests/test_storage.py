"""Saving is atomic, without pickle; loading checks what it reads."""

import os

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import sigmapoint as sp
from sigmapoint.storage import write_atomically

TREE = {"a": jnp.arange(3.0), "b": (jnp.ones((2, 2), jnp.float32), jnp.int32(4))}


def test_round_trip_keeps_every_bit(tmp_path):
    sp.save(tmp_path / "s.npz", TREE)
    back = sp.load(tmp_path / "s.npz", like=TREE)
    np.testing.assert_array_equal(back["a"], TREE["a"])
    assert back["b"][0].dtype == jnp.float32
    assert int(back["b"][1]) == 4
    assert os.listdir(tmp_path) == ["s.npz"]


def test_a_result_can_be_saved(tmp_path):
    model = sp.StateSpaceModel(
        lambda x, u: x, lambda x, u: x, np.eye(1), np.eye(1), sp.Gaussian(np.zeros(1), np.eye(1))
    )
    post = sp.filter(model, np.ones((4, 1)))
    sp.save(tmp_path / "post", post)
    np.testing.assert_array_equal(sp.load(tmp_path / "post", like=post).mean, post.mean)
    back = sp.load(tmp_path / "post", like=jax.eval_shape(lambda: sp.filter(model, np.zeros((4, 1)))))
    np.testing.assert_array_equal(back.cov, post.cov)
    assert back.labels == post.labels
    with pytest.raises(ValueError, match=r"in the file but float64\(5, 1\) in `like`"):
        sp.load(tmp_path / "post", like=jax.eval_shape(lambda: sp.filter(model, np.zeros((5, 1)))))


def test_a_failed_write_leaves_the_old_file_and_nothing_else(tmp_path):
    sp.save(tmp_path / "s.npz", TREE)

    def full(file):
        file.write(b"half")
        raise OSError(28, "No space left on device")

    with pytest.raises(OSError, match="No space left"):
        write_atomically(tmp_path / "s.npz", full)
    assert os.listdir(tmp_path) == ["s.npz"]
    sp.load(tmp_path / "s.npz", like=TREE)


def test_what_cannot_be_loaded_says_why(tmp_path):
    sp.save(tmp_path / "s.npz", TREE)
    with pytest.raises(ValueError, match="another structure"):
        sp.load(tmp_path / "s.npz", like={"a": jnp.zeros(3)})
    with pytest.raises(ValueError, match=r"\['a'\] is float64\(3,\).*\(4,\)"):
        sp.load(tmp_path / "s.npz", like={**TREE, "a": jnp.zeros(4)})
    (tmp_path / "text").write_text("hello")
    with pytest.raises(ValueError, match=r"not written by sp\.save"):
        sp.load(tmp_path / "text", like=TREE)
    np.savez(tmp_path / "other.npz", x=np.ones(2))
    with pytest.raises(ValueError, match=r"not written by sp\.save"):
        sp.load(tmp_path / "other.npz", like=TREE)
    with pytest.raises(FileNotFoundError):
        sp.load(tmp_path / "missing", like=TREE)
    with pytest.raises(ValueError, match="not an array"):
        sp.save(tmp_path / "f", {"f": print})


def test_of_a_result_with_functions_in_it_the_message_names_what_can_be_saved(tmp_path):
    def build(a):
        return sp.StateSpaceModel(
            lambda x, u: a * x, lambda x, u: x, np.eye(1), np.eye(1), sp.Gaussian(np.zeros(1), np.eye(1))
        )

    y = np.sin(np.arange(20.0))[:, None]
    fit = sp.fit(build, sp.real(0.5, 0.3), y, method=sp.ekf())
    with pytest.raises(ValueError, match=r"\.build is not an array but function; save its \.theta, \.estimates"):
        sp.save(tmp_path / "s.npz", fit)
    sp.save(tmp_path / "s.npz", fit.estimates)
    assert sp.load(tmp_path / "s.npz", like=fit.estimates).value == fit.theta
    learned = sp.em(build(0.9), y, method=sp.ekf(), tolerance=0.1)
    with pytest.raises(ValueError, match=r"save its \.model\.process_noise, .*, \.model\.initial"):
        sp.save(tmp_path / "s.npz", learned)
    sp.save(tmp_path / "s.npz", learned.model.initial)
    with pytest.raises(ValueError, match="functions are not saved, the numbers that they use are"):
        sp.save(tmp_path / "s.npz", build(0.9))
