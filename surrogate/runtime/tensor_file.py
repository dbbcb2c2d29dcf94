"""Files of named tensors (safetensors) that contain a digest and are written atomically."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save
from torch import Tensor

from shared_schema.common.errors import InputError, first_line
from shared_schema.common.files import complete_or_absent, require_plain
from surrogate.runtime.device import memory_errors

Tensors = dict[str, Tensor]
DIGEST = "digest"
TENSOR_DIGEST = "sha256"  # in files of earlier versions, which leaves out the metadata


def serialised(tensors: Tensors, metadata: dict[str, str] | None = None) -> bytes:
    """Content of a file of tensors, text metadata and a digest of both."""
    contiguous = {  # a single element that is seen in many places counts as contiguous as it is
        name: value.detach().cpu().clone(memory_format=torch.contiguous_format)
        for name, value in tensors.items()
    }
    text = metadata or {}
    return save(contiguous, {**text, DIGEST: tensor_digest(contiguous, text)})


def save_atomically(tensors: Tensors, path: Path, metadata: dict[str, str] | None = None) -> None:
    """Write a file of tensors, text metadata and a digest of both."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with complete_or_absent(path) as partial:
        partial.write_bytes(serialised(tensors, metadata))


def load_tensors(path: Path) -> tuple[Tensors, dict[str, str]]:
    """Read tensors and text metadata; nothing is unpickled.

    Raises
    ------
    InputError
        If the file is damaged (a single changed bit of a tensor or of the metadata is found), a
        link, or larger than the memory.
    """
    require_plain(path.parent, path)
    try:
        with memory_errors(), safe_open(path, framework="pt") as file:
            metadata = file.metadata() or {}
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    except (SafetensorError, OSError, KeyError, TypeError, ValueError) as error:
        raise InputError(f"{path}: damaged ({first_line(error)})") from None
    digest, text = metadata.pop(DIGEST, None), metadata
    if digest is None:
        digest, text = metadata.pop(TENSOR_DIGEST, None), {}
    if digest != tensor_digest(tensors, text):
        raise InputError(f"{path}: damaged (the tensors do not match their digest)")
    return tensors, metadata


def tensor_digest(tensors: Tensors, metadata: Mapping[str, str]) -> str:
    """Return the SHA-256 of names, types, shapes and bytes of tensors, and of text metadata."""
    digest = hashlib.sha256()
    for name in sorted(tensors):
        value = tensors[name]
        digest.update(f"{name} {value.dtype} {tuple(value.shape)}".encode())
        digest.update(value.reshape(-1).view(torch.uint8).numpy().tobytes())
    for key in sorted(metadata):
        digest.update(json.dumps([key, metadata[key]]).encode())
    return digest.hexdigest()
