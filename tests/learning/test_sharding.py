"""Parameters spread over devices: the same numbers as on one."""

import os
import subprocess
import sys
import textwrap

import pytest

import sigmapoint as sp

PROGRAM = """
import tempfile
import jax, jax.numpy as jnp, numpy as np, sigmapoint as sp
jax.config.update("jax_enable_x64", True)
devices = jax.devices()
assert len(devices) == 4
r = np.random.default_rng(0)
w = {"in": r.normal(size=(24, 2)), "out": r.normal(size=(2, 24)) / 5}  # 96 parameters
x, d = r.normal(size=(12, 2)), r.normal(size=(12, 2))
g = lambda w, x: w["out"] @ jnp.tanh(w["in"] @ x)
for method in (sp.srcdkf(), sp.at_mean(sp.srukf(alpha=0.1)), sp.ekf()):
    fits = [
        sp.learn(g, w, x, d, noise=0.1, method=method, drift=sp.robbins_monro(1e-4, 0.1), epochs=2, key=0, devices=on,
                 validation=(x, d))
        for on in ((None, devices, devices[:3]) if method == sp.srcdkf() else (None, devices))
    ]
    for fit in fits[1:]:
        np.testing.assert_allclose(fit.state.mean, fits[0].state.mean, rtol=1e-9, atol=1e-11)
        np.testing.assert_allclose(fit.state.cov, fits[0].state.cov, rtol=1e-8, atol=1e-11)
        np.testing.assert_allclose(fit.predict(x[0]).std, fits[0].predict(x[0]).std, rtol=1e-8)
    if method.belief.__name__ == "SquareRoot":
        factor = fits[1].state.uncertainty.columns
        assert factor.sharding.shard_shape(factor.shape) == (96, 24), factor.sharding
        assert fits[1].state.mean.sharding.shard_shape((96,)) == (24,)
hidden = lambda w, x: jnp.tanh(w["in"] @ x)
cell = sp.recurrent(lambda w, h, x: (hidden(w, x)[:4] + 0.3 * h, w["out"] @ hidden(w, x) + h[:2]), np.zeros(4))
one, four = (sp.learn(cell, w, x, d, noise=0.1, epochs=2, devices=on) for on in (None, devices))
np.testing.assert_allclose(four.state.mean, one.state.mean, rtol=1e-9, atol=1e-11)
with tempfile.TemporaryDirectory() as folder:  # half of it on four devices, the rest on one
    def stop(p):
        if p.epoch == 2:
            raise KeyboardInterrupt
    given = dict(noise=0.1, epochs=3, key=0, checkpoint=folder + "/c.npz")
    try:
        sp.learn(g, w, x, d, **given, devices=devices, progress=stop)
    except KeyboardInterrupt:
        pass
    resumed = sp.learn(g, w, x, d, **given)
whole = sp.learn(g, w, x, d, noise=0.1, epochs=3, key=0)
np.testing.assert_allclose(resumed.state.mean, whole.state.mean, rtol=1e-9, atol=1e-11)
print("same")
"""


def test_four_devices_learn_what_one_does():
    flags = os.environ.get("XLA_FLAGS", "") + " --xla_force_host_platform_device_count=4"
    command = [sys.executable, "-c", textwrap.dedent(PROGRAM)]
    ran = subprocess.run(command, env=os.environ | {"XLA_FLAGS": flags}, capture_output=True, text=True)
    assert ran.stdout.strip() == "same", ran.stderr


def test_parameters_are_spread_evenly():
    with pytest.raises(ValueError, match="3 parameters cannot be spread evenly over 2 devices"):
        sp.learner(lambda w, x: w @ x, [1.0, 2.0, 3.0], noise=1.0, devices=["a", "b"])
    with pytest.raises(ValueError, match="devices must be a list"):
        sp.learner(lambda w, x: w * x, 1.0, noise=1.0, devices=[])
