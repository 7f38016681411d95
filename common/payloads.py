"""Messages as bytes. Models and experience are safetensors files; control is JSON. Nothing is unpickled.

The paper's payload (section IV-A) is binary weights, task, round and average running reward: here tensors,
with the other fields in the safetensors metadata, so that a payload saved from the bus opens in any ML tool.
Headers are padded to a fixed size: a robot's payload is as long in round 9 as in round 10.
"""

from __future__ import annotations

import json
import math
import struct
from collections.abc import Mapping
from typing import Annotated, Any, Literal, TypeVar

import numpy as np
import numpy.typing as npt
import safetensors
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, FiniteFloat, ValidationError

from common.bus import Payload
from common.errors import PayloadError

Array = npt.NDArray[Any]
Weights = Mapping[str, npt.NDArray[np.float32]]
Shapes = Mapping[str, tuple[int, ...]]

MAX_HEADER_BYTES = 64 * 1024
_DTYPES: dict[str, np.dtype[Any]] = {"F32": np.dtype("<f4"), "U8": np.dtype("u1")}
_MALFORMED = (
    ValueError,
    KeyError,
    TypeError,
    AttributeError,
    RecursionError,
    struct.error,
    safetensors.SafetensorError,
)
_CODES = {dtype: code for code, dtype in _DTYPES.items()}


def _from_json(value: object) -> object:
    return json.loads(value) if isinstance(value, str) else value


class _Header(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class ModelHeader(_Header):
    """Metadata of a model on the wire: the paper's fields, and what the neighbours decide with."""

    schema_: Literal["jouleswarm.model/1"] = Field("jouleswarm.model/1", alias="schema")
    task: int = Field(ge=0, description="0: the meta-model")
    agent: int = Field(ge=0, description="0: the data center")
    round: int = Field(ge=0)
    reward: FiniteFloat | None = Field(None, description="average running reward R of the sender")
    samples: int = Field(0, ge=0, description="|E_k|: new transitions of the round")
    rewards: Annotated[dict[int, tuple[int, FiniteFloat]], BeforeValidator(_from_json)] = Field(
        default_factory=dict, description="newest known (round, episode reward) of each robot of the cluster"
    )
    padding: str = ""


class MotionHeader(_Header):
    """Metadata of one motion's experience (x_h, y_h, r_h)."""

    schema_: Literal["jouleswarm.experience/1"] = Field("jouleswarm.experience/1", alias="schema")
    task: int = Field(ge=1)
    agent: int = Field(ge=1)
    round: int = Field(ge=1)
    motion: int = Field(ge=0)
    action: int = Field(ge=0, le=3)
    reward: FiniteFloat
    first: Annotated[bool, BeforeValidator(_from_json)] = Field(description="the frame opens an episode")
    terminated: Annotated[bool, BeforeValidator(_from_json)]
    padding: str = ""


class Presence(_Header):
    """Where a robot stands: `stage` only grows while it lives (see agents/agent.py)."""

    agent: int
    stage: int = 0
    state: Literal["here", "gone"] = Field("here", description="gone: the last will of a process that died")


class RoundRequest(_Header):
    """Asks for the messages of rounds `first` to `last`."""

    first: int = Field(ge=0)
    last: int = Field(ge=0)


class Episode(_Header):
    """A robot's greedy episode with the data center's model of a round (centralized learning)."""

    agent: int = Field(ge=1)
    round: int = Field(ge=1)
    reward: FiniteFloat


HeaderT = TypeVar("HeaderT", bound=_Header)


def encode_model(weights: Weights, header: ModelHeader, robots: int = 0) -> bytes:
    """A model as a safetensors file; float32 little-endian tensors in the order given.

    The file is as long as with the rewards of `robots` robots, however many are known yet.
    """
    return _encode(weights, header, 320 + 48 * max(robots, len(header.rewards)))


def decode_model(payload: Payload, shapes: Shapes) -> tuple[dict[str, npt.NDArray[np.float32]], ModelHeader]:
    """Read a model and check it against the expected tensors.

    Raises:
        PayloadError: not a safetensors file, another schema, other names, shapes or dtype, or values not finite.
    """
    expected = {name: ("F32", tuple(shape)) for name, shape in shapes.items()}
    tensors, header = _decode(payload, expected, ModelHeader)
    for name, tensor in tensors.items():
        with np.errstate(invalid="ignore"):  # infinities of both signs add up to NaN, which is what is looked for
            total = float(np.add.reduce(tensor, axis=None, dtype=np.float64))
        if not math.isfinite(total):
            raise PayloadError(f"model of robot {header.agent}, round {header.round}: {name} is not finite")
    return tensors, header


def check_model(payload: Payload) -> ModelHeader:
    """The header of a model of whatever shape, for who only keeps it.

    Raises:
        PayloadError: not a safetensors file with a model's metadata.
    """
    try:
        (length,) = struct.unpack_from("<Q", payload)
        if length > min(MAX_HEADER_BYTES, len(payload)):
            raise PayloadError(f"model: header of {length} bytes, expected at most {MAX_HEADER_BYTES}")
        header = ModelHeader.model_validate(json.loads(bytes(payload[8 : 8 + length]))["__metadata__"])
        safetensors.deserialize(bytes(payload))  # type: ignore[no-untyped-call]
    except ValidationError as error:
        raise PayloadError(f"model: {_first(error)}") from error
    except _MALFORMED as error:
        raise PayloadError(f"model: not a safetensors file with our metadata: {error!r}") from error
    return header


def encode_motion(frame: npt.NDArray[np.uint8], header: MotionHeader) -> bytes:
    """One motion: the camera frame, uint8 [height, width, 4], with action, reward and flags."""
    return _encode({"frame": frame}, header, 320)


def decode_motion(payload: Payload, height: int, width: int) -> tuple[npt.NDArray[np.uint8], MotionHeader]:
    """Read one motion.

    Raises:
        PayloadError: not a motion of this frame size.
    """
    tensors, header = _decode(payload, {"frame": ("U8", (height, width, 4))}, MotionHeader)
    return tensors["frame"], header


def encode_json(message: BaseModel) -> bytes:
    """A small control message."""
    return message.model_dump_json(by_alias=True).encode()


MessageT = TypeVar("MessageT", bound=BaseModel)


def decode_json(payload: Payload, kind: type[MessageT], limit_bytes: int = MAX_HEADER_BYTES) -> MessageT:
    """Read a small control message.

    Raises:
        PayloadError: not JSON, or not of that kind.
    """
    if len(payload) > limit_bytes:
        raise PayloadError(f"{kind.__name__}: {len(payload)} bytes, expected at most {limit_bytes}")
    try:
        return kind.model_validate_json(bytes(payload))
    except ValidationError as error:
        raise PayloadError(f"{kind.__name__}: {_first(error)}") from error


def _encode(tensors: Mapping[str, Array], header: _Header, metadata_bytes: int) -> bytes:
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


def _metadata(header: _Header, size_bytes: int) -> dict[str, str]:
    fields = header.model_dump(mode="json", by_alias=True, exclude={"padding"})
    metadata = {key: value if isinstance(value, str) else json.dumps(value) for key, value in fields.items()}
    metadata = {key: value for key, value in metadata.items() if value != "null"}
    metadata["padding"] = ""
    used = len(json.dumps(metadata, separators=(",", ":")))
    return {**metadata, "padding": " " * max(0, size_bytes - used)}


def _decode(
    payload: Payload, expected: Mapping[str, tuple[str, tuple[int, ...]]], kind: type[HeaderT]
) -> tuple[dict[str, Array], HeaderT]:
    what = kind.__name__.removesuffix("Header").lower()
    size = sum(_DTYPES[code].itemsize * math.prod(shape) for code, shape in expected.values())
    if not size < len(payload) <= size + 8 + MAX_HEADER_BYTES:
        raise PayloadError(f"{what}: {len(payload)} bytes, expected {size} and a header")
    (length,) = struct.unpack_from("<Q", payload)
    if length != len(payload) - 8 - size:
        raise PayloadError(f"{what}: header of {length} bytes, expected {len(payload) - 8 - size}")
    try:
        entries = json.loads(bytes(payload[8 : 8 + length]))
        header = kind.model_validate(entries.pop("__metadata__"))
        found = {name: (entry["dtype"], tuple(entry["shape"])) for name, entry in entries.items()}
        if found != dict(expected):
            raise PayloadError(f"{what}: tensors {_difference(found, expected)}")
        tensors = dict(safetensors.deserialize(bytes(payload)))  # type: ignore[no-untyped-call]
    except ValidationError as error:
        raise PayloadError(f"{what}: {_first(error)}") from error
    except _MALFORMED as error:
        raise PayloadError(f"{what}: not a safetensors file with our metadata: {error!r}") from error
    return {
        name: np.frombuffer(tensors[name]["data"], _DTYPES[code]).reshape(shape)
        for name, (code, shape) in expected.items()
    }, header


def _difference(found: Mapping[str, object], expected: Mapping[str, object]) -> str:
    for name in [*expected, *found]:
        if found.get(name) != expected.get(name):
            return f"{name}: got {found.get(name)}, expected {expected.get(name)}"
    return "differ"


def _first(error: ValidationError) -> str:
    item = error.errors(include_url=False)[0]
    return f"{'.'.join(map(str, item['loc']))}: {item['msg']}"
