"""Binary data inside an HTML file: gzipped, in base64; arrays with a table of their places."""

from __future__ import annotations

import gzip
from base64 import b64encode
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

LEVEL = 9
ALIGNMENT = 8  # of arrays, as typed arrays of JavaScript need


def inlined(content: bytes) -> str:
    """Compress, and write in base64."""
    return in_base64(gzip.compress(content, LEVEL, mtime=0))


def in_base64(content: bytes) -> str:
    """Write in base64."""
    return b64encode(content).decode("ascii")


def packed(arrays: Mapping[str, NDArray[Any]]) -> tuple[dict[str, dict[str, Any]], bytes]:
    """Join arrays to one block of bytes, little-endian.

    Returns
    -------
    table : dict
        Type, shape and offset in bytes of every array.
    block : bytes
    """
    table, parts, offset = {}, [], 0
    for name, array in arrays.items():
        content = np.ascontiguousarray(array, array.dtype.newbyteorder("<")).tobytes()
        content += bytes(-len(content) % ALIGNMENT)
        table[name] = {"type": array.dtype.name, "shape": list(array.shape), "offset": offset}
        parts.append(content)
        offset += len(content)
    return table, b"".join(parts)
