"""Particles spread over devices, and series over devices: the same numbers as on one. A million of them fit."""

import os
import subprocess
import sys

import pytest

import sigmapoint as sp

SPREAD = """
import jax
import jax.numpy as jnp
import numpy as np

import sigmapoint as sp

jax.config.update("jax_enable_x64", True)
devices = jax.devices()
assert len(devices) == 4
model = sp.StateSpaceModel(
    lambda x, u: 0.9 * x + 0.1 * jnp.sin(x), lambda x, u: x, 0.5 * jnp.eye(2), 0.25 * jnp.eye(2),
    sp.Gaussian(jnp.ones(2), jnp.eye(2)))
y = np.array([[1.5, 0.0], [np.nan, 1.0], [0.4, 0.1], [-1.0, np.nan]])
guided = sp.proposals.guided(sp.srekf())
for options in ({}, {"proposal": guided, "move": sp.moves.random_walk(), "threshold": 1.0}):
    one, four = (
        sp.filter(model, y, method=sp.particle_filter(400, devices=on, **options), key=0,
                  keep=("mean", "std", "particles", "log_weights"))
        for on in (None, devices)
    )
    for name in ("mean", "std", "particles", "log_weights", "log_likelihood", "ess"):
        np.testing.assert_allclose(getattr(four, name), getattr(one, name), rtol=1e-5, atol=1e-5)
    assert not one.particles.sharding.device_set - {devices[0]}
many = np.stack([y] * 6)
batch = sp.batch(model, many, method=sp.bootstrap(400), key=0, keep=("mean",))
for i, key in enumerate(jax.random.split(jax.random.key(0), 6)):
    single = sp.filter(model, y, method=sp.bootstrap(400), key=key, keep=("mean",))
    np.testing.assert_allclose(batch.mean[i], single.mean, rtol=1e-5, atol=1e-5)
live = sp.online(model, sp.particle_filter(400, devices=devices))
state = live.predict(live.update(live.init(key=0), y[0])[0])
assert len(state.particles.sharding.device_set) == 4
"""

MILLION = """
from pathlib import Path

import jax.numpy as jnp
import numpy as np

import sigmapoint as sp

model = sp.StateSpaceModel(
    lambda x, u: 0.9 * x, lambda x, u: x[:1], 0.5 * jnp.eye(4), 0.25 * jnp.eye(1),
    sp.Gaussian(jnp.ones(4), jnp.eye(4)))
post = sp.filter(model, np.ones((20, 1)), method=sp.bootstrap(1_000_000), key=0)
exact = sp.filter(model, np.ones((20, 1)))
np.testing.assert_allclose(post.mean, exact.mean, atol=0.02)
status = dict(line.split(":", 1) for line in Path("/proc/self/status").read_text().splitlines())
print(int(status["VmHWM"].split()[0]) / 2**20)
"""


AS_USERS = {k: v for k, v in os.environ.items() if k not in ("XLA_FLAGS", "SIGMAPOINT_NATIVE")}
"""without the options that tests compile with"""


def run(program, environment):
    done = subprocess.run(
        [sys.executable, "-c", program], env=environment, capture_output=True, text=True, timeout=300, check=False
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_four_devices_give_what_one_does():
    run(SPREAD, os.environ | {"XLA_FLAGS": f"{os.environ['XLA_FLAGS']} --xla_force_host_platform_device_count=4"})


@pytest.mark.skipif(sys.platform != "linux", reason="read from /proc; getrusage counts what the parent had, too")
def test_a_million_particles_of_four_states_take_less_than_two_gigabytes():
    assert float(run(MILLION, AS_USERS)) < 2


def test_what_cannot_be_spread_is_refused():
    with pytest.raises(ValueError, match="3 particles cannot be spread evenly over 2 devices"):
        sp.particle_filter(3, devices=["a", "b"])
    with pytest.raises(ValueError, match="devices must be a list"):
        sp.particle_filter(4, devices=[])
