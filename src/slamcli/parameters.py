# SPDX-License-Identifier: MIT
"""Parameters declared once: name, type, unit, range, default and help.

A tier declares its parameters as a frozen dataclass whose fields are made by :func:`parameter`, or by :func:`group` for
a nested dataclass. Loading, checks, ``config show``, ``config check`` and the documentation are derived from that
declaration.
"""

from __future__ import annotations

import dataclasses
import difflib
import math
import operator
from collections.abc import Iterable, Iterator, Mapping
from typing import Any, TypeVar

from slamcli.errors import ConfigError

_TRUE = {"true", "1", "yes", "on"}
_FALSE = {"false", "0", "no", "off"}

T = TypeVar("T")


@dataclasses.dataclass(frozen=True, slots=True)
class Declaration:
    """One parameter as its users know it."""

    name: str
    """Native name, e.g. ``lstep``, ``Kp/MaxFeatures`` or ``POSE_GRAPH.constraint_builder.min_score``."""
    field: str
    """Name of the dataclass field that holds its value; of one in a group the way there: ``submaps.num_range_data``."""
    kind: type
    """bool, int, float or str."""
    default: Any
    """Default value; None where it is derived from the data (the help says how)."""
    unit: str
    help: str
    minimum: float | None
    maximum: float | None
    choices: tuple[str, ...]
    effective: bool
    """False for a parameter that is accepted but has no meaning offline."""
    extension: bool
    """True for a parameter that the followed system does not have."""
    unavailable: Mapping[str, str] = dataclasses.field(default_factory=dict)
    """Values that the followed system has and slamcli has not: why, and what to choose instead."""


def parameter(
    default: Any,
    help: str,
    *,
    name: str | None = None,
    kind: type | None = None,
    unit: str = "",
    minimum: float | None = None,
    maximum: float | None = None,
    choices: Iterable[str] = (),
    unavailable: Mapping[str, str] | None = None,
    effective: bool = True,
    extension: bool = False,
) -> Any:
    """Declare one parameter as a dataclass field; see :class:`Declaration` for the meaning of the arguments."""
    metadata = dict(
        name=name,
        kind=kind or type(default),
        unit=unit,
        help=help,
        minimum=minimum,
        maximum=maximum,
        choices=tuple(choices),
        unavailable=dict(unavailable or {}),
        effective=effective,
        extension=extension,
    )
    return dataclasses.field(default=default, metadata={"parameter": metadata})


def group(default: Any, *, name: str | None = None, separator: str = ".") -> Any:
    """Declare a group of parameters: a field whose value is another parameter dataclass.

    Parameters
    ----------
    default
        Instance with the values that are the defaults here (a dataclass may stand in several places with others).
    name
        What comes before the native names of its parameters; "" adds nothing. Default: the field's name.
    separator
        What joins the two.
    """
    return dataclasses.field(default=default, metadata={"group": {"name": name, "separator": separator}})


def declarations(parameters: type) -> tuple[Declaration, ...]:
    """Return the declarations of a parameter dataclass in the order in which they are written; groups are flattened."""
    return tuple(_declared(parameters, None, "", ""))


def _declared(parameters: type, defaults: Any, name_prefix: str, field_prefix: str) -> Iterator[Declaration]:
    for field in dataclasses.fields(parameters):
        default = field.default if defaults is None else getattr(defaults, field.name)
        if "group" in field.metadata:
            name = field.metadata["group"]["name"]
            name = field.name if name is None else name
            prefix = f"{name_prefix}{name}{field.metadata['group']['separator']}" if name else name_prefix
            yield from _declared(type(default), default, prefix, f"{field_prefix}{field.name}.")
            continue
        facts = dict(field.metadata["parameter"])
        facts["name"] = name_prefix + (facts["name"] or field.name)
        yield Declaration(field=field_prefix + field.name, default=default, **facts)


def resolve(parameters: type[T], *layers: Mapping[str, Any], source: str = "") -> T:
    """Return an instance of `parameters` with the values of `layers` (native names) over the defaults; later wins.

    Raises
    ------
    ConfigError
        If a name is unknown (the message names the nearest one), or a value has the wrong type or range.
    """
    known = {d.name: d for d in declarations(parameters)}
    values: dict[str, Any] = {}
    for layer in layers:
        for name, value in layer.items():
            if name not in known:
                raise ConfigError(unknown_name(name, known, source))
            values[known[name].field] = convert(known[name], value)
    resolved: T = _replaced(parameters(), values)
    return resolved


def _replaced(parameters: Any, values: Mapping[str, Any]) -> Any:
    """Return a parameter dataclass with other values, which are named by the way to their field."""
    own = {way: value for way, value in values.items() if "." not in way}
    inner: dict[str, dict[str, Any]] = {}
    for way, value in values.items():
        first, dot, rest = way.partition(".")
        if dot:
            inner.setdefault(first, {})[rest] = value
    own |= {name: _replaced(getattr(parameters, name), below) for name, below in inner.items()}
    return dataclasses.replace(parameters, **own) if own else parameters


def unknown_name(name: str, known: Iterable[str], source: str = "") -> str:
    """Return the message for a parameter that does not exist, with the nearest names that do."""
    known = list(known)
    lowered = {k.lower(): k for k in known}
    near = [k for k in known if "." not in name and k.lower().endswith(f".{name.lower()}")][
        :2
    ]  # a key without its tables
    near = near or [lowered[n] for n in difflib.get_close_matches(name.lower(), lowered, n=2, cutoff=0.5)]
    if not near:  # the last part of a dotted name alone
        last = name.lower().rpartition(".")[2]
        ends = difflib.get_close_matches(last, {k.lower().rpartition(".")[2] for k in known}, n=1, cutoff=0.8)
        near = [k for k in known if k.lower().rpartition(".")[2] in ends][:2]
    where = f" in {source}" if source else ""
    hint = f"; did you mean {' or '.join(near)}?" if near else "; `slamcli config show` lists all of them"
    return f"unknown parameter {name!r}{where}{hint}"


def convert(declaration: Declaration, value: Any) -> Any:
    """Return `value` (text or a native type) as the declared type, checked against range and choices."""
    if value is None or (isinstance(value, str) and declaration.default is None and value.lower() == "auto"):
        return declaration.default
    try:
        converted = _as_kind(declaration.kind, value)
    except (ValueError, TypeError, OverflowError) as error:
        kind = {"bool": "true or false", "int": "a whole number", "float": "a number"}.get(
            declaration.kind.__name__, "text"
        )
        raise ConfigError(f"{declaration.name}={value!r}: not {kind}") from error
    if str(converted) in declaration.unavailable:
        raise ConfigError(f"{declaration.name}={value!r}: {declaration.unavailable[str(converted)]}")
    if (
        declaration.choices
        and str(converted) not in declaration.choices
        and not _numeric_choice(declaration, converted)
    ):
        raise ConfigError(f"{declaration.name}={value!r}: choose one of {', '.join(declaration.choices)}")
    if isinstance(converted, float) and math.isnan(converted):
        raise ConfigError(f"{declaration.name}={value!r}: not a number")
    low, high = declaration.minimum, declaration.maximum
    if isinstance(converted, (int, float)) and (
        (low is not None and converted < low) or (high is not None and converted > high)
    ):
        bounds = (
            f"at least {low:g}"
            if high is None
            else f"at most {high:g}"
            if low is None
            else f"between {low:g} and {high:g}"
        )
        raise ConfigError(f"{declaration.name}={value!r}: must be {bounds} {declaration.unit}".rstrip())
    return converted


def convert_at(declaration: Declaration, value: Any, source: str) -> Any:
    """Return `value` as :func:`convert` does, for files in which numbers are finite.

    Raises
    ------
    ConfigError
        With `source`, the place of the value, if it has the wrong type or range, is a list where one value is declared, or
        is infinite.
    """
    takes_lists = isinstance(declaration.default, str) and declaration.default.startswith("[")
    if isinstance(value, (list, dict)) and not takes_lists:
        raise ConfigError(f"{source}: {declaration.name}={value!r}: one value, not a list or map of them")
    try:
        converted = convert(declaration, value)
    except ConfigError as error:
        raise ConfigError(f"{source}: {error}") from error
    if isinstance(converted, float) and math.isinf(converted):
        raise ConfigError(f"{source}: {declaration.name}={value!r}: not a finite number")
    return converted


def _numeric_choice(declaration: Declaration, value: Any) -> bool:
    """Whether a choice parameter such as ``auto|SECONDS`` was given its number."""
    if "NUMBER" not in declaration.choices:
        return False
    try:
        return math.isfinite(float(value))
    except ValueError:
        return False


def as_dict(parameters: Any) -> dict[str, Any]:
    """Return the values of a parameter dataclass instance by native name."""
    return {d.name: operator.attrgetter(d.field)(parameters) for d in declarations(type(parameters))}


def _as_kind(kind: type, value: Any) -> Any:
    if kind is bool:
        if isinstance(value, bool):
            return value
        text = str(value).strip().lower()
        if text in _TRUE:
            return True
        if text in _FALSE:
            return False
        raise ValueError(value)
    if isinstance(value, bool):
        raise TypeError(value)
    if kind is int:
        if isinstance(value, str):
            return int(value, 0) if value.strip().lower().startswith(("0x", "-0x")) else _whole(float(value))
        return _whole(value)
    if kind is float:
        return float(value)
    return str(value)


def _whole(value: Any) -> int:
    if value != int(value):
        raise ValueError(value)
    return int(value)
