"""Tensors and a header as one safetensors file: written byte by byte the same, read with nothing taken on trust."""

from __future__ import annotations

import json
import math
import struct
from collections.abc import Mapping, Sequence
from typing import Any, TypeVar

import numpy as np
import safetensors
from pydantic import BaseModel, ConfigDict, ValidationError

from jouleswarm.common.errors import PayloadError
from jouleswarm.common.wire.types import Array, Layout, Payload

MAX_HEADER_BYTES = 64 * 1024
_DTYPES: dict[str, np.dtype[Any]] = {
    "F64": np.dtype("<f8"),
    "F32": np.dtype("<f4"),
    "F16": np.dtype("<f2"),
    "I64": np.dtype("<i8"),
    "I32": np.dtype("<i4"),
    "I16": np.dtype("<i2"),
    "I8": np.dtype("i1"),
    "U64": np.dtype("<u8"),
    "U32": np.dtype("<u4"),
    "U16": np.dtype("<u2"),
    "U8": np.dtype("u1"),
    "BOOL": np.dtype("bool"),
}
_CODES = {dtype: code for code, dtype in _DTYPES.items()}
_MALFORMED = (
    ValueError,
    KeyError,
    TypeError,
    AttributeError,
    RecursionError,
    struct.error,
    safetensors.SafetensorError,
)


def code_of(dtype: str) -> str:
    """What safetensors calls a NumPy dtype."""
    return _CODES[np.dtype(dtype)]


class Header(BaseModel):
    """What a file says besides its tensors; fields that are None are left out."""

    model_config = ConfigDict(frozen=True, extra="forbid")


HeaderT = TypeVar("HeaderT", bound=Header)


def encode_tensors(tensors: Mapping[str, Array], header: Header, metadata_bytes: int) -> bytes:
    """A safetensors file, tensors in the order given, metadata padded to `metadata_bytes`."""
    # The library writes metadata in random order; a fixed order makes equal models equal files.
    entries: dict[str, Any] = {"__metadata__": _metadata(header, metadata_bytes)}
    offset, parts = 0, []
    for name, tensor in tensors.items():
        end = offset + tensor.nbytes
        entries[name] = {"dtype": _CODES[tensor.dtype], "shape": tensor.shape, "data_offsets": [offset, end]}
        parts.append(np.ascontiguousarray(tensor).reshape(-1).view(np.uint8).data)
        offset = end
    text = json.dumps(entries, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 8)
    return b"".join([struct.pack("<Q", len(text)), text, *parts])


def decode_tensors(
    payload: Payload, layouts: Sequence[Layout], kind: type[HeaderT], what: str
) -> tuple[dict[str, Array], HeaderT]:
    """Read a file that has one of `layouts`, and its header; `what` names it in errors.

    Raises:
        PayloadError: not a safetensors file, another header, or other names, shapes or dtypes.
    """
    fitting = _of_this_size(payload, layouts, what)
    try:
        entries, header = _header(payload, kind)
        found = {name: (entry["dtype"], tuple(entry["shape"])) for name, entry in entries.items()}
        layout = next((each for each in fitting if found == dict(each)), None)
        if layout is None:
            raise PayloadError(f"{what}: tensors {_difference(found, fitting[0])}")
        tensors = _tensors(payload)
        return {name: _array(tensors[name], code, shape) for name, (code, shape) in layout.items()}, header
    except ValidationError as error:
        raise PayloadError(f"{what}: {first_reason(error)}") from error
    except _MALFORMED as error:
        raise PayloadError(f"{what}: not a safetensors file with our metadata: {error!r}") from error


def decode_floats(payload: Payload, kind: type[HeaderT], what: str) -> tuple[dict[str, Array], HeaderT]:
    """A safetensors file of whatever float32 tensors, and its header.

    Raises:
        PayloadError: not a safetensors file with such a header, or with tensors of another dtype.
    """
    try:
        (length,) = struct.unpack_from("<Q", payload)
        if length > min(MAX_HEADER_BYTES, len(payload)):
            raise PayloadError(f"{what}: header of {length} bytes, expected at most {MAX_HEADER_BYTES}")
        _, header = _header(payload, kind)
        tensors = {}
        for name, tensor in _tensors(payload).items():
            if tensor["dtype"] != "F32":
                raise PayloadError(f"{what}: {name} in {tensor['dtype']}, expected F32")
            tensors[name] = _array(tensor, "F32", tuple(tensor["shape"]))
        return tensors, header
    except ValidationError as error:
        raise PayloadError(f"{what}: {first_reason(error)}") from error
    except _MALFORMED as error:
        raise PayloadError(f"{what}: not a safetensors file with our metadata: {error!r}") from error


def layout_of(tensors: Mapping[str, Array]) -> Layout:
    """How tensors lie on the wire; a dtype that does not go there has numpy's name."""
    return {name: (_CODES.get(tensor.dtype) or str(tensor.dtype), tensor.shape) for name, tensor in tensors.items()}


def layout_bytes(layout: Layout) -> int:
    """Bytes of the tensors of a message, header apart.

    Raises:
        KeyError: a dtype that does not go on the wire.
    """
    return sum(_DTYPES[code].itemsize * math.prod(shape) for code, shape in layout.values())


def tensor_bytes(payload: Payload) -> int:
    """Bytes that a file's tensors take by its own account: all but the header; negative where it has none."""
    if len(payload) < 8:
        return -1
    (length,) = struct.unpack_from("<Q", payload)
    return len(payload) - 8 - int(length)


def first_reason(error: ValidationError) -> str:
    """The first thing wrong, with the name of the field."""
    item = error.errors(include_url=False)[0]
    return f"{'.'.join(map(str, item['loc']))}: {item['msg']}"


def _of_this_size(payload: Payload, layouts: Sequence[Layout], what: str) -> list[Layout]:
    """The layouts whose tensors together are as long as the payload's; nothing is allocated before this holds."""
    sizes = [layout_bytes(layout) for layout in layouts]
    expected = " or ".join(str(size) for size in sizes)
    if not any(size < len(payload) <= size + 8 + MAX_HEADER_BYTES for size in sizes):
        raise PayloadError(f"{what}: {len(payload)} bytes, expected {expected} and a header")
    left = tensor_bytes(payload)
    if left not in sizes or len(payload) - 8 - left > MAX_HEADER_BYTES:
        wanted = " or ".join(str(len(payload) - 8 - size) for size in sizes)
        raise PayloadError(f"{what}: header of {len(payload) - 8 - left} bytes, expected {wanted}")
    return [layout for layout, size in zip(layouts, sizes, strict=True) if size == left]


def _header(payload: Payload, kind: type[HeaderT]) -> tuple[dict[str, Any], HeaderT]:
    """The file's entries for tensors, and its metadata."""
    (length,) = struct.unpack_from("<Q", payload)
    entries = json.loads(bytes(payload[8 : 8 + length]))
    header = kind.model_validate(entries.pop("__metadata__"))
    return entries, header


def _tensors(payload: Payload) -> dict[str, dict[str, Any]]:
    return dict(safetensors.deserialize(bytes(payload)))  # type: ignore[no-untyped-call]


def _array(tensor: dict[str, Any], code: str, shape: tuple[int, ...]) -> Array:
    return np.frombuffer(tensor["data"], _DTYPES[code]).reshape(shape)


def _metadata(header: Header, size_bytes: int) -> dict[str, str]:
    fields = header.model_dump(mode="json", by_alias=True, exclude={"padding"}, exclude_none=True)
    metadata = {key: value if isinstance(value, str) else json.dumps(value) for key, value in fields.items()}
    metadata["padding"] = ""
    used = len(json.dumps(metadata, separators=(",", ":")))
    return {**metadata, "padding": " " * max(0, size_bytes - used)}


def _difference(found: Mapping[str, object], expected: Mapping[str, object]) -> str:
    for name in [*expected, *found]:
        if found.get(name) != expected.get(name):
            return f"{name}: got {found.get(name)}, expected {expected.get(name)}"
    return "differ"
