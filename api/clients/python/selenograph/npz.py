"""NPZ archives as the service writes and reads them."""

from __future__ import annotations

import io
import json
import os
import struct
import zipfile
from typing import Any, Dict, Mapping, Tuple

import numpy as np

NPY_HEAD_BYTES = 4096  # upper bound of the head of an array in NPY format 1.0, as the service writes it
LOCAL_HEADER_BYTES = 30  # fixed part of a ZIP member's local header; name and extra field follow
NAME_LENGTH_OFFSET = 26  # offset of the two lengths in the local header


def read_npz(content: bytes) -> Tuple[Dict[str, np.ndarray], Dict[str, Any]]:
    """Returns the arrays ("range") and the JSON texts ("meta") of an archive, by name."""
    # Take stored members from the bytes: numpy.load would verify their checksums, which takes as long as a frame.
    arrays: Dict[str, np.ndarray] = {}
    texts: Dict[str, Any] = {}
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        for info in archive.infolist():
            if info.compress_type == zipfile.ZIP_STORED:
                lengths_at = info.header_offset + NAME_LENGTH_OFFSET
                name_bytes, extra_bytes = struct.unpack_from("<HH", content, lengths_at)
                start = info.header_offset + LOCAL_HEADER_BYTES + name_bytes + extra_bytes
                member = memoryview(content)[start:start + info.file_size]
            else:
                member = memoryview(archive.read(info))
            name, suffix = os.path.splitext(info.filename)
            if suffix == ".json":
                texts[name] = json.loads(bytes(member))
            elif suffix == ".npy":
                arrays[name] = _read_npy(member)
    return arrays, texts


def _read_npy(member: memoryview) -> np.ndarray:
    head = io.BytesIO(member[:NPY_HEAD_BYTES])
    if np.lib.format.read_magic(head) != (1, 0):
        return np.load(io.BytesIO(member), allow_pickle=False)
    shape, is_fortran, dtype = np.lib.format.read_array_header_1_0(head)
    values = np.frombuffer(member, dtype, count=int(np.prod(shape)), offset=head.tell())
    # Copy: the array becomes aligned and writable, and no longer holds the archive's memory.
    return values.reshape(shape, order="F" if is_fortran else "C").copy()


def write_npz(request: bytes, arrays: Mapping[str, np.ndarray]) -> bytes:
    """Returns an archive with the arrays and with a request's JSON as the text `request`."""
    file = io.BytesIO()
    np.savez(file, request=request.decode(), **arrays)
    return file.getvalue()
