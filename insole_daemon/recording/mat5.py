"""Read matrices of numbers from a little-endian MATLAB file of version 5 to 7.

scipy's reader is not used: it sometimes crashes the process on a damaged file (segmentation fault, scipy 1.17).

An element is a tag and its bytes, padded to a multiple of 8. The tag is type and length, 4 bytes each, or, for up to 4
bytes of data, 2 bytes each followed by the data. A matrix is an element of elements: flags, dimensions, name, then the
numbers. For a struct the name is followed by the length of the field names, the names, and one matrix per field.
Source: MathWorks, MAT-File Format, R2025a.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

_HEADER_BYTES: Final = 128
_MAX_BYTES: Final = 1 << 28  # of one decompressed variable
_DTYPES: Final = {1: "<i1", 2: "<u1", 3: "<i2", 4: "<u2", 5: "<i4", 6: "<u4", 7: "<f4", 9: "<f8", 12: "<i8", 13: "<u8"}
_MATRIX, _COMPRESSED = 14, 15  # types of elements
_STRUCT, _NUMBERS = 2, range(6, 16)  # classes of matrices


class _Element(NamedTuple):
    type: int
    data: memoryview


class _Matrix(NamedTuple):
    kind: int
    shape: tuple[int, ...]
    name: str
    rest: Iterator[_Element]  # after flags, dimensions and name


def read_struct(path: Path, name: str) -> dict[str, NDArray[np.float64] | None]:
    """Read the struct `name`: matrices by field, None for a field without numbers; {} if the file has no such struct.

    Raises OSError if the file cannot be read, and ValueError with the reason if it is damaged.
    """
    content = path.read_bytes()
    if content[:10] != b"MATLAB 5.0" or content[126:128] != b"IM":
        kind = "a file of version 7.3 (save it with -v7)" if content[:10] == b"MATLAB 7.3" else repr(content[:20])
        raise ValueError(f"it begins with {kind}")
    for element in _iterate_elements(memoryview(content)[_HEADER_BYTES:], padded=False):
        if element.type == _COMPRESSED:
            element = next(_iterate_elements(memoryview(_decompress(element.data)), padded=False))
        matrix = _parse_matrix(element)
        if matrix is not None and matrix.name == name and matrix.kind == _STRUCT:
            return _parse_fields(matrix.rest)
    return {}


def _iterate_elements(data: memoryview, padded: bool = True) -> Iterator[_Element]:
    """Yield the elements of `data`; they are padded inside matrices, and matrices are padded themselves."""
    while data:
        if len(data) < 8:
            raise ValueError("an element is cut off")
        kind, size = int.from_bytes(data[:4], "little"), int.from_bytes(data[4:8], "little")
        if kind >> 16:
            kind, size, body, padded_size = kind & 0xFFFF, kind >> 16, data[4:8], 8
        else:
            body, padded_size = data[8:], 8 + size + (-size % 8 if padded or kind == _MATRIX else 0)
        if size > len(body):
            raise ValueError(f"an element has {size} bytes and {len(body)} are left")
        yield _Element(kind, body[:size])
        data = data[padded_size:]


def _decompress(data: memoryview) -> bytes:
    """Return a decompressed variable; ValueError if it is damaged or too large."""
    stream = zlib.decompressobj()
    try:
        content = stream.decompress(data, _MAX_BYTES)
    except zlib.error as error:
        raise ValueError(f"a compressed variable is damaged ({error})") from error
    if not stream.eof:
        raise ValueError(f"a compressed variable is cut off, or has more than {_MAX_BYTES} bytes")
    return content


def _parse_matrix(element: _Element) -> _Matrix | None:
    """Return class, shape, name and content of a matrix; None if the element is not a matrix."""
    if element.type != _MATRIX or not element.data:
        return None
    elements = _iterate_elements(element.data)
    flags, dimensions, name = next(elements, None), next(elements, None), next(elements, None)
    if flags is None or dimensions is None or name is None or len(flags.data) < 1:
        raise ValueError("a matrix is cut off")
    shape = _parse_numbers(dimensions).astype(np.int64)
    if not len(shape) or len(shape) > 32 or (shape < 0).any():
        raise ValueError(f"a matrix has the dimensions {shape[:4].tolist()}")
    return _Matrix(flags.data[0], tuple(shape.tolist()), bytes(name.data).decode("latin-1"), elements)


def _parse_fields(elements: Iterator[_Element]) -> dict[str, NDArray[np.float64] | None]:
    """Return the fields of a struct; None for a field without numbers."""
    length, names = next(elements, None), next(elements, None)
    if length is None or names is None:
        raise ValueError("a struct is cut off")
    width = int.from_bytes(length.data[:4], "little")
    if not 1 <= width <= 64:  # MATLAB's names have up to 63 characters
        raise ValueError(f"the names of a struct's fields have {width} bytes")
    text = bytes(names.data)
    fields = [text[at : at + width].split(b"\0")[0].decode("latin-1") for at in range(0, len(text), width)]
    return {field: _parse_values(element) for field, element in zip(fields, elements, strict=False)}


def _parse_values(element: _Element) -> NDArray[np.float64] | None:
    """Return (shape) the numbers of a matrix, the real part of complex ones; None if it holds something else."""
    matrix = _parse_matrix(element)
    if matrix is None or matrix.kind not in _NUMBERS:
        return None
    real = next(matrix.rest, None)
    if real is None:
        raise ValueError("a matrix has no numbers")
    values, size = _parse_numbers(real), 1
    for axis in matrix.shape:
        size *= axis
    if len(values) != size:
        raise ValueError(f"a matrix of {matrix.shape} has {len(values)} numbers")
    return values.astype(np.float64).reshape(matrix.shape, order="F")


def _parse_numbers(element: _Element) -> NDArray[np.generic]:
    dtype = np.dtype(_DTYPES.get(element.type, "V1"))
    if dtype.kind == "V" or len(element.data) % dtype.itemsize:
        raise ValueError(f"expected numbers, found {len(element.data)} bytes of type {element.type}")
    return np.frombuffer(element.data, dtype)
