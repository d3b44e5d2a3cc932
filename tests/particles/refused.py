"""What particle filters refuse, and what they say."""

import jax.numpy as jnp
import numpyro.distributions as dist
from particles.scalar_case import MODEL, Y

import sigmapoint as sp

INSIDE = sp.NonAdditive(jnp.eye(1))
FLAT = sp.StateSpaceModel(
    lambda x, u: x,
    lambda x, u: x[:1],
    jnp.diag(jnp.array([1.0, 0.0])),
    jnp.eye(1),
    sp.Gaussian(jnp.zeros(2), jnp.eye(2)),
)


def model(**parts):
    given = {"process_noise": jnp.eye(1), "observation_noise": jnp.eye(1), "initial": MODEL.initial}
    return sp.StateSpaceModel(lambda x, u, *w: x, lambda x, u, *v: x, **(given | parts))


def known():
    return model(initial=sp.Gaussian(jnp.zeros(1), jnp.zeros((1, 1))))


def own(cov):
    return sp.particle_filter(10, proposal=sp.proposals.prior(process_noise=cov))


def tailed():
    two = dist.MixtureSameFamily(dist.Categorical(jnp.array([0.5, 0.5])), dist.Normal(jnp.zeros(2), jnp.ones(2)))
    return model(observation_noise=two)


REFUSED = {
    "no key": (lambda: sp.filter(MODEL, Y, method=sp.bootstrap(10)), "key is missing: a particle filter draws"),
    "no key online": (lambda: sp.online(MODEL, sp.bootstrap(10)).init(), "key is missing"),
    "a key that is none": (lambda: sp.filter(MODEL, Y, method=sp.bootstrap(10), key="a"), "key must be"),
    "no particles": (lambda: sp.bootstrap(0), "particles must be a whole number of at least 1"),
    "threshold": (lambda: sp.particle_filter(10, threshold=1.5), "threshold must be greater than 0"),
    "proposal": (lambda: sp.particle_filter(10, proposal=sp.ukf()), r"proposal must be sp.proposals.prior\(\)"),
    "move without parentheses": (
        lambda: sp.particle_filter(10, move=sp.moves.random_walk),
        r"move must be sp.moves.*; call it: move=sp.moves.random_walk\(\)",
    ),
    "proposal without a method": (
        lambda: sp.particle_filter(10, proposal=sp.proposals.guided),
        r"call it: proposal=sp.proposals.guided\(method\)",
    ),
    "a function of one's own": (lambda: sp.particle_filter(10, proposal=lambda x: x), r"got function$"),
    "compare without a key": (
        lambda: sp.compare(MODEL, Y, methods={"ukf": sp.ukf(), "bootstrap": sp.bootstrap(10)}),
        "key is missing",
    ),
    "resampling": (lambda: sp.particle_filter(10, resampling="systematic"), "resampling must be a function"),
    "guided by particles": (lambda: sp.proposals.guided(sp.bootstrap(3)), "method must be a sp.Method"),
    "auxiliary of a Gaussian": (lambda: sp.auxiliary(sp.ukf()), "method must be a particle filter"),
    "scale of a walk": (lambda: sp.moves.random_walk(0), "scale must be positive"),
    "without parentheses": (
        lambda: sp.filter(MODEL, Y, method=sp.bootstrap, key=0),
        r"method must be .*call it: method=sp.bootstrap\(particles\)",
    ),
    "keep particles of a Gaussian": (lambda: sp.filter(MODEL, Y, keep=("particles",)), "keep has unknown name"),
    "v inside": (
        lambda: sp.filter(model(observation_noise=INSIDE), Y, method=sp.bootstrap(10), key=0),
        "observation_noise must be additive for a particle filter, which needs its density",
    ),
    "w inside, guided": (
        lambda: sp.filter(model(process_noise=INSIDE), Y, method=sp.upf(10), key=0),
        "process_noise must be additive for a proposal that looks at the measurement.*sp.bootstrap",
    ),
    "w inside, auxiliary": (
        lambda: sp.filter(model(process_noise=INSIDE), Y, method=sp.auxiliary(sp.bootstrap(10)), key=0),
        "process_noise must be additive",
    ),
    "flat noise, guided": (lambda: sp.filter(FLAT, Y, method=sp.upf(10), key=0), "process_noise has a singular cov"),
    "flat noise, drawn from another": (
        lambda: sp.filter(FLAT, Y, method=own(jnp.eye(2)), key=0),
        "process_noise has a singular covariance, and so no density, which a proposal with a noise of its own",
    ),
    "its own noise of another size": (
        lambda: sp.filter(MODEL, Y, method=own(jnp.eye(2)), key=0),
        r"process_noise of the proposal must be \(1, 1\)",
    ),
    "its own noise is none": (lambda: own(-jnp.eye(1)), "process_noise has a negative variance"),
    "flat noise, moved": (
        lambda: sp.filter(FLAT, Y, method=sp.particle_filter(10, move=sp.moves.random_walk()), key=0),
        "process_noise has a singular covariance.*independence",
    ),
    "exact sensor": (
        lambda: sp.filter(model(observation_noise=jnp.zeros((1, 1))), Y, method=sp.bootstrap(10), key=0),
        "observation_noise has a singular covariance",
    ),
    "rts of particles": (
        lambda: sp.smooth(MODEL, Y, method=sp.bootstrap(10), smoother=sp.rts(), key=0),
        "smoother must be sp.backward_sim.*for ParticleMethod, got RTS",
    ),
    "backward simulation of a Gaussian": (
        lambda: sp.smooth(MODEL, Y, smoother=sp.backward_simulation()),
        r"smoother must be sp.rts\(\)",
    ),
    "backward simulation of flat noise": (
        lambda: sp.smooth(FLAT, Y, method=sp.bootstrap(10), smoother=sp.backward_simulation(), key=0),
        "process_noise has a singular covariance.*fixed_lag",
    ),
    "em of particles": (lambda: sp.em(MODEL, Y, method=sp.bootstrap(10)), "method must be a sp.Method, a Gaussian"),
    "a state of another method": (
        lambda: sp.online(MODEL).update(sp.online(MODEL, sp.bootstrap(10)).init(key=0), [1.0]),
        "state must come from",
    ),
    "no components": (lambda: sp.gspf(10, 0), "components must be a whole number of at least 1"),
    "more components than particles": (lambda: sp.gmsppf(10, 20), "particles must be a whole number of at least 20"),
    "no iterations": (lambda: sp.gmsppf(10, 2, iterations=0), "iterations must be"),
    "a Gaussian sum of particles": (lambda: sp.gspf(10, 2, method=sp.bootstrap(3)), "method must be a sp.Method"),
    "no key, Gaussian sum": (
        lambda: sp.filter(MODEL, Y, method=sp.gspf(10, 2)),
        "key is missing: a Gaussian-sum filter draws",
    ),
    "ancestors of a Gaussian sum": (
        lambda: sp.filter(MODEL, Y, method=sp.gspf(10, 2), key=0, keep=("ancestors",)),
        "keep has unknown name",
    ),
    "a Gaussian sum known exactly": (
        lambda: sp.filter(known(), jnp.ones((2, 1)), method=sp.gmsppf(10, 2), key=0),
        "initial has a singular covariance",
    ),
    "rts of a Gaussian sum": (
        lambda: sp.smooth(MODEL, Y, method=sp.gspf(10, 2), key=0),
        "there is no smoother",
    ),
    "trajectories of a Gaussian sum": (
        lambda: sp.trajectories(MODEL, Y, method=sp.gspf(10, 2), key=0, draws=3),
        "there are no trajectories of GaussianSumMethod",
    ),
    "nothing sampled": (lambda: sp.rao_blackwellised(10, ()), "sampled must be places or names"),
    "sampled by particles": (
        lambda: sp.rao_blackwellised(10, (0,), method=sp.bootstrap(3)),
        "method must be a sp.Method",
    ),
    "sampled by another name": (
        lambda: sp.filter(MODEL, Y, method=sp.rao_blackwellised(10, ("tone",)), key=0),
        "sampled must be .* got 'tone'",
    ),
    "a Gaussian filter of a distribution": (
        lambda: sp.filter(tailed(), Y, method=sp.rao_blackwellised(10, (0,)), key=0),
        "observation_noise must be a Gaussian for a Rao-Blackwellised filter",
    ),
    "fewer particles than proposals": (
        lambda: sp.filter(tailed(), Y, method=sp.gspf(15, 10), key=0),
        "particles must be at least 20",
    ),
    "sampled through the dynamics": (
        lambda: sp.filter(model(process_noise=INSIDE), Y, method=sp.rao_blackwellised(10, (0,)), key=0),
        "process_noise must be additive for a Rao-Blackwellised filter",
    ),
    "sampled out of place": (
        lambda: sp.filter(MODEL, Y, method=sp.rao_blackwellised(10, (3,)), key=0),
        "sampled must be places from 0 to 0",
    ),
}
