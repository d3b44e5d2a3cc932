"""The compiled functions of a live filter, one set for all models that differ in arrays only."""

from functools import lru_cache
from typing import Any, NamedTuple

import jax
from jaxtyping import Array

from sigmapoint.compiled.native import looped
from sigmapoint.recipe import Recipe, Run


class Calls(NamedTuple):
    """The compiled functions of a model and a method."""

    init: Any
    update: Any
    predict: Any
    step: Any


@lru_cache(maxsize=64)
def calls(structure: Any, rest: tuple[Any, ...], method: Recipe) -> Calls:
    """For models that differ in arrays only; `rest` is their leaves, with nothing in place of the arrays."""

    def run(arrays: list[Array], key: Any = None) -> Run:
        left = iter(arrays)
        leaves = [next(left) if leaf is None else leaf for leaf in rest]
        return method.ready(jax.tree.unflatten(structure, leaves), key)

    def update(arrays: list[Array], state: Any, y: Any, u: Any, once: Any) -> tuple[Any, Any]:
        return looped(lambda state, arrays, y, u: run(arrays).update(state, y, u), state, once, arrays, y, u)

    def predict(arrays: list[Array], state: Any, u: Any, once: Any) -> Any:
        return looped(lambda state, arrays, u: (run(arrays).predict(state, u), None), state, once, arrays, u)[0]

    def step(arrays: list[Array], state: Any, y: Any, u: Any, once: Any) -> Any:
        after, info = update(arrays, state, y, u, once)
        return after, info, predict(arrays, after, u, once)

    return Calls(jax.jit(lambda arrays, key: run(arrays, key).init()), jax.jit(update), jax.jit(predict), jax.jit(step))
