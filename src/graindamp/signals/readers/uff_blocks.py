"""The datasets of a universal file, free of the stray bytes that front ends leave in it."""

import re
from collections.abc import Collection
from pathlib import Path

from graindamp.errors import InputError

_START = re.compile(rb"^ {4}-1[ \0\r]*\n[ \0]*(\d+)(b?)", re.MULTILINE | re.IGNORECASE)
_END = re.compile(rb"^ {4}-1[ \0\r]*$", re.MULTILINE)
_END_OF_BINARY = re.compile(rb"[\s\0]* {4}-1[ \0\r]*$", re.MULTILINE)
_HEADER = re.compile(rb"(?:[^\n]*\n){13}")
"""Delimiter, dataset number and the eleven records of dataset 58 before its numbers."""

_N_HEADER = 13


def tidy_datasets(path: Path, kinds: Collection[int]) -> list[bytes]:
    """Datasets of `kinds` with their delimiters, in the order of the file.

    Null bytes, carriage returns and trailing blanks are dropped from text; binary numbers (dataset 58b) are cut to
    their announced length, which front ends overrun by line feeds or padding.

    Raises:
        InputError: no dataset at all, or one without its end.
    """
    data = path.read_bytes().removeprefix(b"\xef\xbb\xbf")
    if not re.search(rb"^ {4}58b", data, re.MULTILINE | re.IGNORECASE):
        data = data.replace(b"\0", b"").replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    blocks, position = [], 0
    while start := _START.search(data, position):
        number = int(start[1])
        read = _binary_block if start[2] else _text_block
        block, position = read(data, start, f"{path}: dataset {number} at byte {start.start()}")
        if number in kinds:
            blocks.append(block)
    if position == 0:
        raise InputError(f"{path}: holds no dataset (lines '    -1', '    58'); not a universal file, or damaged")
    return blocks


def _text_block(data: bytes, start: re.Match[bytes], place: str) -> tuple[bytes, int]:
    """A dataset of text, and where the next may begin."""
    end = _END.search(data, start.end())
    if end is None:
        raise InputError(f"{place}: has no end (a line '    -1'); the file is cut off, export it again")
    lines = _lines(data[start.start() : end.start()])
    lines = lines[:_N_HEADER] + [line for line in lines[_N_HEADER:] if line]
    return b"\n".join([*lines, b"    -1\n"]), end.end()


def _binary_block(data: bytes, start: re.Match[bytes], place: str) -> tuple[bytes, int]:
    """A dataset 58b, and where the next may begin."""
    header = _HEADER.match(data, start.start())
    if header is None:
        raise InputError(f"{place}: ends in its header; the file is cut off, export it again")
    lines = _lines(header[0])[:_N_HEADER]
    try:
        number_type, n_value, spacing = (int(field) for field in lines[8].split()[:3])
    except ValueError:
        raise InputError(f"{place}: record 7 is {lines[8]!r}, not the form of the data; export it again") from None
    size = n_value * (4 if number_type in (2, 5) else 8) * (1 if number_type in (2, 4) else 2)
    size += 0 if spacing else n_value * (4 if number_type in (2, 5) else 8)
    end = _END_OF_BINARY.match(data, header.end() + size)
    if end is None:
        raise InputError(
            f"{place}: no end after {size} bytes of numbers, as announced; the file is cut off or of another "
            "precision, export it again as ASCII"
        )
    return b"\n".join(lines) + b"\n" + data[header.end() : header.end() + size] + b"    -1\n", end.end()


def _lines(text: bytes) -> list[bytes]:
    return [line.replace(b"\0", b"").rstrip() for line in text.split(b"\n")]
