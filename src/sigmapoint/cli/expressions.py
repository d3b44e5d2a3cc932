"""Methods written as text, like `srukf`, `ukf(alpha=1e-3)` or `iterated(srukf(), 3)`; parsed, never evaluated."""

import ast
import difflib
import inspect
from collections.abc import Callable
from typing import Any

from sigmapoint.cli.errors import InputError
from sigmapoint.methods import METHODS, Method
from sigmapoint.particles.gaussian_sum.method import gmsppf, gspf
from sigmapoint.particles.method import ParticleMethod, auxiliary, bootstrap, ekpf, upf
from sigmapoint.recipe import Recipe
from sigmapoint.variants import VARIANTS

DRAWING = {make.__name__: make for make in (bootstrap, ekpf, upf, gspf, gmsppf)}
OF_PARTICLES = {auxiliary.__name__: auxiliary}
EVERY: dict[str, Callable[..., Any]] = METHODS | DRAWING | VARIANTS | OF_PARTICLES
INNER = dict.fromkeys(VARIANTS, (Method, "srukf()")) | dict.fromkeys(OF_PARTICLES, (ParticleMethod, "upf(200)"))
"""What the first argument of those around a method is, and an example."""


def parse_method(text: str) -> Recipe:
    """The method that an expression stands for.

    Args:
        text: a name, or a call with numbers as arguments; those around a method take that first.

    Raises:
        InputError: an unknown name (with the list of names), or anything but names, calls and numbers.

    Examples:
        >>> parse_method("iterated(srukf(), 3)").iterations
        3
    """
    try:
        tree = ast.parse(text.strip(), mode="eval").body
        return _method(tree, text)
    except InputError:
        raise
    except (SyntaxError, ValueError, RecursionError, MemoryError) as error:  # a null byte is a ValueError before 3.11.4
        raise InputError(f"method {_short(text)!r} is not an expression such as srukf or ukf(alpha=1e-3)") from error


def parse_methods(text: str) -> dict[str, Recipe]:
    """Methods separated by commas outside parentheses, by their expressions."""
    parts = split(text)
    if not all(parts):
        raise InputError(f"--methods {_short(text)!r} has an empty entry; write names and commas, like ekf,srukf")
    if len(set(parts)) < len(parts):
        raise InputError(f"--methods {_short(text)!r} names a method twice")
    return {part: parse_method(part) for part in parts}


def split(text: str) -> list[str]:
    """Parts between the commas outside parentheses."""
    parts, depth = [""], 0
    for character in text:
        depth += {"(": 1, ")": -1}.get(character, 0)
        if character == "," and depth == 0:
            parts.append("")
        else:
            parts[-1] += character
    return [part.strip() for part in parts]


def _method(tree: ast.expr, text: str) -> Recipe:
    call = tree if isinstance(tree, ast.Call) else ast.Call(tree, [], [])
    if not isinstance(call.func, ast.Name):
        raise InputError(f"method {_short(text)!r}: write only method names, calls and numbers, as in ukf(alpha=1)")
    name = call.func.id
    if name not in EVERY:
        raise InputError(_unknown(name))
    inner = [_method(call.args[0], text)] if name in INNER and call.args else []
    positional = [*inner, *(_number(a, text) for a in call.args[len(inner) :])]
    if any(keyword.arg is None for keyword in call.keywords):
        raise InputError(f"method {_short(text)!r}: ** is not allowed")
    keywords = {str(k.arg): _number(k.value, text) for k in call.keywords}
    return _called(name, EVERY[name], positional, keywords)


def _called(name: str, function: Callable[..., Recipe], positional: list[Any], keywords: dict[str, Any]) -> Recipe:
    signature = inspect.signature(function)
    try:
        bound = signature.bind(*positional, **keywords)
    except TypeError as error:
        raise InputError(f"method {name}: {error}; its arguments are {_arguments(signature)}") from error
    if name in INNER and not isinstance(bound.arguments["method"], INNER[name][0]):
        raise InputError(f"method {name}: the first argument must be a method, like {name}({INNER[name][1]})")
    for key, value in bound.arguments.items():
        if signature.parameters[key].annotation is int and not isinstance(value, int):
            raise InputError(f"method {name}: {key} must be a whole number, got {value}")
    try:
        return function(*bound.args, **bound.kwargs)
    except ValueError as error:
        raise InputError(f"method {name}: {error}") from error


def _arguments(signature: inspect.Signature) -> str:
    listed = [p.name if p.default is p.empty else f"{p.name}={p.default:.4g}" for p in signature.parameters.values()]
    return f"({', '.join(listed)})"


def _number(tree: ast.expr, text: str) -> int | float:
    if isinstance(tree, ast.UnaryOp) and isinstance(tree.op, ast.USub):
        return -_number(tree.operand, text)
    if isinstance(tree, ast.Constant) and type(tree.value) in (int, float):
        return tree.value  # pyright: ignore[reportReturnType]
    raise InputError(f"method {_short(text)!r}: {_short(ast.unparse(tree))!r} is not a number")


def _unknown(name: str) -> str:
    close = difflib.get_close_matches(name, EVERY, n=1)
    hint = f" Did you mean {close[0]}?" if close else ""
    return (
        f"unknown method {_short(name)!r}.{hint} Methods: {', '.join(METHODS)}; of particles, as in upf(200): "
        f"{', '.join(DRAWING)}; around a method: {', '.join(INNER)}"
    )


def _short(text: str) -> str:
    return text if len(text) <= 60 else text[:57] + "..."
