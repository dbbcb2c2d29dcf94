"""Files of named tensors (safetensors) that contain a digest and are written atomically."""

from __future__ import annotations

import hashlib
from pathlib import Path

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save
from torch import Tensor

from shared_schema.common.atomic_file import complete_or_absent
from shared_schema.common.errors import InputError, first_line

Tensors = dict[str, Tensor]
DIGEST = "sha256"


def save_atomically(tensors: Tensors, path: Path, metadata: dict[str, str] | None = None) -> None:
    """Write tensors, text metadata and a digest of the tensors."""
    path.parent.mkdir(parents=True, exist_ok=True)
    contiguous = {name: value.detach().cpu().contiguous() for name, value in tensors.items()}
    text = {**(metadata or {}), DIGEST: tensor_digest(contiguous)}
    with complete_or_absent(path) as partial:
        partial.write_bytes(save(contiguous, text))


def load_tensors(path: Path) -> tuple[Tensors, dict[str, str]]:
    """Read tensors and text metadata; nothing is unpickled.

    Raises
    ------
    InputError
        If the file is damaged; a single changed bit of a tensor is found.
    """
    try:
        with safe_open(path, framework="pt") as file:
            metadata = file.metadata() or {}
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    except (SafetensorError, OSError, KeyError, TypeError, ValueError) as error:
        raise InputError(f"{path}: damaged ({first_line(error)})") from None
    if metadata.get(DIGEST) != tensor_digest(tensors):
        raise InputError(f"{path}: damaged (the tensors do not match their digest)")
    return tensors, metadata


def tensor_digest(tensors: Tensors) -> str:
    """Return the SHA-256 of names, types, shapes and bytes of tensors, sorted by name."""
    digest = hashlib.sha256()
    for name in sorted(tensors):
        value = tensors[name]
        digest.update(f"{name} {value.dtype} {tuple(value.shape)}".encode())
        digest.update(value.reshape(-1).view(torch.uint8).numpy().tobytes())
    return digest.hexdigest()
