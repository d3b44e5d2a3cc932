"""Terrain-aided navigation: an aircraft finds its place from the height of the ground that it flies over.

    p⁺ = p + v dt + w₁        y = terrain(p) + e        p [m] along a straight track, v [m/s] over ground
    v⁺ = v + w₂                                         y [m]: barometer minus radar altimeter

Heights say much and not all: another place may be as high, and as high for a while after. Here the terrain is a row of
ridges, each like the one before (a period of 3 km, with two harmonics), upon a wide relief. From one ridge to the next
the ground differs by

    terrain(p + 3 km) − terrain(p) = B (1 − cos θ)² sin θ = B (5/4 sin θ − sin 2θ + 1/4 sin 3θ),  θ = 2π p / 36 km,

which is zero at p = 0 up to the fourth derivative: below 1 m for |p| < 4.6 km, and 12 m at p = 9 km (B = 12 m). At the
start the position is known to 2 km, so that two to four ridges may lie below; which one it is shows late.

Source: Bergman, "Recursive Bayesian Estimation: Navigation and Tracking Applications", Linköping Studies in Science and
Technology, Dissertations 579 (1999); Nordlund & Gustafsson, "Marginalized particle filter for accurate and reliable
terrain-aided navigation", IEEE Transactions on Aerospace and Electronic Systems 45 (2009). The model is theirs, along a
line; terrain and numbers are ours.
"""

import jax.numpy as jnp
from jaxtyping import Array, Float

from sigmapoint.model import StateSpaceModel
from sigmapoint.noise import Gaussian

RIDGE = 3000.0
"""[m] from one to the next"""
RIDGES = ((60.0, 3000.0, 0.0), (25.0, 1500.0, 1.0), (10.0, 1000.0, 2.0))
"""amplitude [m], wavelength [m], phase at p = 0 [rad]"""
DIFFERENCE, PERIOD = 12.0, 36_000.0
"""[m] the number B above, and the distance after which ridges repeat their differences"""
RELIEF = ((-28.978, 1), (12.0, 2), (-2.1213, 3))
"""amplitude [m] of cosines about half a ridge, −B cⱼ / (2 sin(jπ RIDGE / PERIOD)) with c = 5/4, −1, 1/4; multiple j"""
LEVEL = 400.0
"""[m] of the terrain, on average"""
STEP, STEPS = 1.0, 150
"""[s] from one measurement to the next, and how many"""
SPEED = 100.0
"""[m/s] as the inertial system has it"""
START_STD = (2000.0, 1.0)
"""[m, m/s] of what is known at first"""
PROCESS_STD = (5.0, 0.1)
"""[m, m/s] gained in a step"""
HEIGHT_STD = 5.0
"""[m] of a measured height"""


def height(p: Float[Array, "*N"]) -> Float[Array, "*N"]:
    """Of the ground [m], at places `p` [m] along the track.

    Examples:
        >>> import jax.numpy as jnp
        >>> from sigmapoint.problems import terrain
        >>> here, next_ridge, late = terrain.height(jnp.array([0.0, terrain.RIDGE, 12_000.0]))
        >>> bool(abs(next_ridge - here) < 0.01), bool(abs(late - here) > 5)
        (True, True)
    """
    ridges = [a * jnp.sin(2 * jnp.pi / wavelength * p + phase) for a, wavelength, phase in RIDGES]
    theta = 2 * jnp.pi / PERIOD * (p - RIDGE / 2)
    relief = [a * jnp.cos(j * theta) for a, j in RELIEF]
    return sum(ridges + relief, jnp.full_like(p, LEVEL))


def difference(p: Float[Array, "*N"]) -> Float[Array, "*N"]:
    """By how much [m] the ground is higher one ridge further on."""
    theta = 2 * jnp.pi / PERIOD * p
    return DIFFERENCE * (1 - jnp.cos(theta)) ** 2 * jnp.sin(theta)


def model() -> StateSpaceModel:
    """Place and speed, seen through the height of the ground once a second.

    Examples:
        >>> import sigmapoint as sp
        >>> from sigmapoint.problems import terrain
        >>> x, y = sp.simulate(terrain.model(), terrain.STEPS, key=0)
        >>> x.shape, y.shape
        ((150, 2), (150, 1))
    """
    return StateSpaceModel(
        dynamics=_dynamics,
        observation=_observation,
        process_noise=jnp.diag(jnp.asarray(PROCESS_STD) ** 2),
        observation_noise=HEIGHT_STD**2 * jnp.eye(1),
        initial=Gaussian(jnp.array([0.0, SPEED]), jnp.diag(jnp.asarray(START_STD) ** 2)),
        state_names=("position", "speed"),
        state_units=("m", "m/s"),
        observation_names=("height",),
        observation_units=("m",),
    )


def _dynamics(x: Float[Array, "2"], u: None) -> Float[Array, "2"]:
    return jnp.stack([x[0] + STEP * x[1], x[1]])


def _observation(x: Float[Array, "2"], u: None) -> Float[Array, "1"]:
    return height(x[:1])
