# SPDX-License-Identifier: MIT
"""The small expressions of ``$(eval ..)``, ``deg(..)`` and ``rad(..)``: numbers, text, comparisons, arithmetic.

Nothing is ever passed to Python's own evaluation: the expression is parsed and walked, and what is not listed here is
refused.
"""

from __future__ import annotations

import ast
import math
import operator
from collections.abc import Callable, Mapping
from typing import Any

from slamcli.errors import ConfigError

_MAX_CHARACTERS = 500
_MAX_TEXT = 10_000

_BINARY: dict[type[ast.operator], Callable[[Any, Any], Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.FloorDiv: operator.floordiv,
    ast.Mod: operator.mod,
}
_UNARY: dict[type[ast.unaryop], Callable[[Any], Any]] = {
    ast.UAdd: operator.pos,
    ast.USub: operator.neg,
    ast.Not: operator.not_,
}
_COMPARE: dict[type[ast.cmpop], Callable[[Any, Any], bool]] = {
    ast.Eq: operator.eq,
    ast.NotEq: operator.ne,
    ast.Lt: operator.lt,
    ast.LtE: operator.le,
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
    ast.In: lambda a, b: a in b,
    ast.NotIn: lambda a, b: a not in b,
}
_CONSTANTS = {"pi": math.pi, "e": math.e, "true": True, "false": False}


def evaluate(
    text: str, names: Mapping[str, Any] | None = None, calls: Mapping[str, Callable[[str], Any]] | None = None
) -> Any:
    """Return the value of an expression.

    Parameters
    ----------
    text
        At most 500 characters: literals, ``+ - * / // %``, comparisons, ``and or not``, ``a if c else b``, ``pi``, ``e``.
    names
        Values that may be named (arguments of a launch file).
    calls
        Functions of one text argument that may be called, such as ``arg``.

    Raises
    ------
    ConfigError
        If it holds anything else, or has no value.
    """
    if len(text) > _MAX_CHARACTERS:
        raise ConfigError(f"expression of {len(text)} characters: at most {_MAX_CHARACTERS} are read")
    try:
        tree = ast.parse(text.strip(), mode="eval")
        return _walk(tree.body, dict(_CONSTANTS) | dict(names or {}), calls or {})
    except (SyntaxError, ValueError, TypeError, ArithmeticError, RecursionError, MemoryError) as error:
        raise ConfigError(f"cannot evaluate {text.strip()!r}: {error}") from error


def _walk(node: ast.expr, names: Mapping[str, Any], calls: Mapping[str, Callable[[str], Any]]) -> Any:
    def walk(child: ast.expr) -> Any:
        return _walk(child, names, calls)

    match node:
        case ast.Constant(value=bool() | int() | float() | str() as value):
            return value
        case ast.Name(id=name) if name in names:
            return names[name]
        case ast.UnaryOp(op=op, operand=operand) if type(op) in _UNARY:
            return _UNARY[type(op)](walk(operand))
        case ast.BinOp(left=left, op=op, right=right) if type(op) in _BINARY:
            return _arithmetic(_BINARY[type(op)], walk(left), walk(right))
        case ast.BoolOp(op=op, values=values):
            results = [walk(value) for value in values]
            return all(results) if isinstance(op, ast.And) else any(results)
        case ast.Compare(left=left, ops=ops, comparators=comparators):
            terms = [walk(left), *map(walk, comparators)]
            return all(_COMPARE[type(op)](a, b) for op, a, b in zip(ops, terms, terms[1:], strict=False))
        case ast.IfExp(test=test, body=body, orelse=orelse):
            return walk(body) if walk(test) else walk(orelse)
        case ast.Call(func=ast.Name(id=name), args=[ast.Constant(value=str() as argument)], keywords=[]) if (
            name in calls
        ):
            return calls[name](argument)
    raise ValueError("only literals, arithmetic, comparisons and arguments are allowed")


def _arithmetic(operation: Callable[[Any, Any], Any], left: Any, right: Any) -> Any:
    if isinstance(left, str) or isinstance(right, str):
        if operation is not operator.add or not (isinstance(left, str) and isinstance(right, str)):
            raise TypeError("text can only be joined to text")
        if len(left) + len(right) > _MAX_TEXT:
            raise ValueError("text too long")
    return operation(left, right)
