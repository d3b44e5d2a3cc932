"""Another rule, with the value at the mean as mean of the values: option 2 of parameter estimation."""

from collections.abc import Callable
from dataclasses import dataclass

import jax.numpy as jnp
from jaxtyping import Array, Float

from sigmapoint.rules.linearization import Linearization, Rule
from sigmapoint.spaces import Space


@dataclass(frozen=True)
class AtMean:
    """`rule`, but for its mean."""

    rule: Rule

    def __call__(self, g: Callable[[Array], Array], factor: Float[Array, "n N"], space: Space) -> Linearization:
        return self.rule(g, factor, space)._replace(mean=g(jnp.zeros_like(factor[:, 0])))

    def about(
        self,
        g: Callable[[Array], Array],
        mean: Float[Array, " n"],
        factor: Float[Array, "n n"],
        space: Space,
    ) -> Linearization:
        return self.rule.about(g, mean, factor, space)._replace(mean=g(mean))
