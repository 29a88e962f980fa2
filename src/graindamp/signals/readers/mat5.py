"""Variables of a MATLAB file of version 5 to 7.

scipy's reader trusts the tags in a file: one damaged byte may crash the interpreter, beyond any message. This one
checks every tag against what is there, and reads only what holds signals.

Source: MathWorks, MAT-File Format, Level 5.
"""

import math
import struct
import zlib
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

_BYTE_ORDER = {b"IM": "<", b"MI": ">"}
_NUMBER = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
_TEXT = {16: "utf-8", 17: "utf-16", 18: "utf-32"}
_MATRIX, _COMPRESSED = 14, 15
_CELL, _STRUCT, _CHAR, _OPAQUE = 1, 2, 4, 17
_NUMERIC = range(6, 16)
_IS_COMPLEX = 0x800

_Element = tuple[int, bytes]


def is_mat5(data: bytes) -> bool:
    """Whether the header is that of version 5 to 7."""
    return len(data) >= 128 and data[126:128] in _BYTE_ORDER


def read_mat5(data: bytes) -> dict[str, Any]:
    """Variables by name: arrays, text as str, a struct as dict, a struct array or cell array as list, objects as None.

    Raises:
        ValueError, zlib.error: the file is damaged.
    """
    order = _BYTE_ORDER[data[126:128]]
    variables = {}
    for kind, body in _elements(data[128:], order):
        if kind == _COMPRESSED:
            kind, body = next(_elements(zlib.decompress(body), order), (0, b""))
        if kind == _MATRIX:
            name, value = _matrix(body, order)
            if name:  # MATLAB appends a nameless one that describes objects
                variables[name] = value
        elif kind or body:
            raise ValueError(f"an element of type {kind} between the variables")
    return variables


def _elements(data: bytes, order: str) -> Iterator[_Element]:
    """Type and content of each element in `data`."""
    position = 0
    while position < len(data):
        if position + 8 > len(data):
            raise ValueError("ends inside an element")
        kind, size = struct.unpack_from(f"{order}II", data, position)
        begin = position + 8
        if kind >> 16:  # small element: size and type share four bytes, the content has the other four
            kind, size, begin = kind & 0xFFFF, kind >> 16, position + 4
        if begin + size > (len(data) if begin == position + 8 else position + 8):
            raise ValueError("an element is longer than what holds it")
        yield kind, data[begin : begin + size]
        position = max(position + 8, begin + size)
        if kind != _COMPRESSED:
            position += -position % 8


def _matrix(body: bytes, order: str) -> tuple[str, Any]:
    """Name and value of a variable, field or cell."""
    if not body:
        return "", np.zeros(0)
    parts = list(_elements(body, order))
    if len(parts) < 2 or parts[0][0] != 6 or len(parts[0][1]) != 8:
        raise ValueError("an array without its flags")
    (flags,) = struct.unpack_from(f"{order}I", parts[0][1])
    code = flags & 0xFF
    if code == _OPAQUE:
        return _name(parts[1]), None
    if len(parts) < 3:
        raise ValueError("an array without its name")
    shape = tuple(int(n) for n in _numbers(parts[1], order))
    name, contents = _name(parts[2]), parts[3:]
    if code in _NUMERIC:
        values = [_numbers(part, order) for part in contents[: 2 if flags & _IS_COMPLEX else 1]]
        if not values or any(part.size != math.prod(shape) for part in values) or min(shape) < 0:
            raise ValueError(f"variable '{name}' does not have the size it announces")
        array = values[0] if len(values) == 1 else values[0] + 1j * values[1]
        return name, array.reshape(shape, order="F")
    if code == _CHAR:
        return name, _text(contents[0], order) if contents else ""
    if code == _STRUCT:
        return name, _structs(contents, math.prod(shape), order)
    if code == _CELL:
        return name, [_matrix(part, order)[1] for kind, part in contents if kind == _MATRIX]
    return name, None


def _structs(contents: list[_Element], n_struct: int, order: str) -> Any:
    """A struct as dict, an array of them as list: length of the field names, all names, the values struct by struct."""
    if len(contents) < 2:
        raise ValueError("a struct without its fields")
    n_char = int(_numbers(contents[0], order)[:1].sum())
    blob = contents[1][1]
    if n_char <= 0 or len(blob) % n_char:
        raise ValueError("a struct with damaged names of its fields")
    names = [_name((1, blob[i : i + n_char])) for i in range(0, len(blob), n_char)]
    values = [_matrix(part, order)[1] for kind, part in contents[2:] if kind == _MATRIX]
    if n_struct < 0 or len(values) != n_struct * len(names):
        raise ValueError("a struct with missing fields")
    if not names:
        return {}
    structs = [dict(zip(names, values[i : i + len(names)], strict=True)) for i in range(0, len(values), len(names))]
    return structs[0] if n_struct == 1 else structs


def _numbers(element: _Element, order: str) -> NDArray[Any]:
    kind, body = element
    if kind not in _NUMBER:
        raise ValueError(f"numbers of unknown type {kind}")
    return np.frombuffer(body, np.dtype(order + _NUMBER[kind]))


def _text(element: _Element, order: str) -> str:
    kind, body = element
    if kind in _TEXT:
        wide = "" if kind == 16 else "-le" if order == "<" else "-be"
        return body.decode(_TEXT[kind] + wide, "replace")
    return "".join(chr(code) for code in _numbers(element, order).astype(np.uint16))


def _name(element: _Element) -> str:
    return element[1].partition(b"\0")[0].decode("utf-8", "replace")
