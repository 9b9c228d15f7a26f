"""Digest of the Python code that a kernel is compiled from.

It covers the bytecode of the kernel and of all functions that it calls, and the constants, arrays and record types that
they name. Comments, docstrings and line numbers do not enter, nor do functions that the kernel does not call.
"""

from __future__ import annotations

import dis
import enum
import functools
import hashlib
import inspect
from collections.abc import Callable, Iterator
from types import BuiltinFunctionType, CodeType, ModuleType
from typing import Any

import numpy as np
from numba import types

_Function = Callable[..., Any]
_ABSENT = object()
_PLAIN = (bool, int, float, complex, str, bytes, type(None), type(...), np.generic, types.Type)
_LIBRARIES = ("builtins", "math", "numba", "numpy", "operator")


class UnknownValueError(TypeError):
    """A kernel names a value whose content has no digest."""


_digests: dict[_Function, str] = {}


def code_digest(function: _Function, callers: frozenset[_Function] = frozenset()) -> str:
    """Digest of a kernel's Python function and of all that it calls; UnknownValueError where a value has none."""
    if function not in _digests:
        callers |= {function}
        text, callees = _text_and_callees(function)
        texts = [_full_name(one) if one in callers else code_digest(one, callers) for one in callees]
        _digests[function] = hashlib.sha256("\n".join([text, *texts]).encode()).hexdigest()
    return _digests[function]


def bytecode_size(function: _Function) -> int:
    """Bytes of the bytecode of a kernel and of all that it calls: compiling takes about as long."""
    return sum(len(one.__code__.co_code) for one in _call_tree(function))


def _call_tree(function: _Function) -> set[_Function]:
    """A function and all that it calls, directly or not."""
    reached: set[_Function] = set()
    waiting = [function]
    while waiting:
        caller = waiting.pop()
        if caller not in reached:
            reached.add(caller)
            waiting += _text_and_callees(caller)[1]
    return reached


def bytecode_text(code: CodeType) -> str:
    """Instructions, constants and names of a code object, including nested functions and classes."""
    constants = [bytecode_text(one) if isinstance(one, CodeType) else _value_text(one) for one in code.co_consts]
    if code.co_flags & inspect.CO_NEWLOCALS and constants and isinstance(code.co_consts[0], str):
        constants[0] = "NoneType None"  # a docstring
    return repr((code.co_code.hex(), constants, code.co_names, code.co_varnames, code.co_argcount, code.co_flags))


@functools.cache
def _text_and_callees(function: _Function) -> tuple[str, tuple[_Function, ...]]:
    """Text of a function and of the values that it names, and the functions that it calls."""
    closure = dict(zip(function.__code__.co_freevars, function.__closure__ or (), strict=True))
    text, callees = [_full_name(function), bytecode_text(function.__code__), _value_text(function.__defaults__)], []
    for name, value in _named_values(function, {name: cell.cell_contents for name, cell in closure.items()}):
        callee = getattr(value, "py_func", None)
        if callee:
            callees.append(callee)
        try:
            text.append(f"{name}: {_full_name(callee) if callee else _value_text(value)}")
        except UnknownValueError:
            if name not in _attributes(function.__code__):
                raise
    return "\n".join(text), tuple(callees)


def _named_values(function: _Function, closure: dict[str, Any]) -> Iterator[tuple[str, Any]]:
    """Global variables and those of the closure that a function names, and the members of modules among them."""
    names = sorted({*_names(function.__code__), *closure})
    for name in names:
        value = closure.get(name, function.__globals__.get(name, _ABSENT))
        if isinstance(value, ModuleType):
            yield from _named_members(value, names)
        elif value is not _ABSENT:
            yield name, value


def _named_members(module: ModuleType, names: list[str]) -> Iterator[tuple[str, Any]]:
    """Members of a module, and of the modules in it unless they are a library's, that have one of these names."""
    for name in names:
        value = getattr(module, name, _ABSENT)
        if not isinstance(value, ModuleType):
            yield from () if value is _ABSENT else [(f"{module.__name__}.{name}", value)]
        elif value.__name__.startswith(f"{module.__name__}.") and value.__name__.partition(".")[0] not in _LIBRARIES:
            yield from _named_members(value, names)


def _names(code: CodeType) -> set[str]:
    inner = (one for one in code.co_consts if isinstance(one, CodeType))
    return set(code.co_names).union(*map(_names, inner))


def _attributes(code: CodeType) -> set[str]:
    """Names of attributes only: a global of the same name is not used."""
    inner = [one for one in code.co_consts if isinstance(one, CodeType)]
    used = {one.argval for one in dis.get_instructions(code) if one.opname in ("LOAD_GLOBAL", "LOAD_NAME")}
    return (set(code.co_names) - used).union(*map(_attributes, inner))


def _value_text(value: Any) -> str:
    """Text that differs where a kernel compiled with this value would."""
    if isinstance(value, type):
        if issubclass(value, enum.Enum):
            members = {name: member.value for name, member in value.__members__.items()}
        else:
            members = dict.fromkeys(getattr(value, "_fields", ())) | getattr(value, "_field_defaults", {})
        return f"class {_full_name(value)} {_value_text(tuple(members.items()))}"
    if isinstance(value, _PLAIN):
        return f"{type(value).__name__} {value!r}"
    if isinstance(value, tuple | list | frozenset):
        texts = [_value_text(one) for one in value]
        return f"{_full_name(type(value))} {sorted(texts) if isinstance(value, frozenset) else texts}"
    if isinstance(value, np.ndarray) and not value.dtype.hasobject:
        return f"array {value.dtype!r} {value.shape} {hashlib.sha256(value.tobytes()).hexdigest()}"
    if isinstance(value, np.dtype):
        return repr(value)
    if isinstance(value, types.ExternalFunction):
        return f"external {value.symbol} {value.sig}"
    module = str(getattr(value, "__module__", None) or "").partition(".")[0]
    if isinstance(value, BuiltinFunctionType | np.ufunc) or module in _LIBRARIES:
        return f"function {module} {getattr(value, '__name__', value)}"
    raise UnknownValueError(f"values of type {type(value).__name__} have no digest")


def _full_name(thing: Any) -> str:
    return f"{thing.__module__}.{thing.__qualname__}"
