"""Models as files that are kept: beside the paper's fields the metadata hold all that a model is used with.

What goes to neighbours every round has no room for it: those bytes are priced. So it is in what is handed in for the
run directory (topics `learned` and `snapshot`), and a file is what was on the bus. No torch is needed to read it.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field

from jouleswarm.common.scenario.spaces import Observation
from jouleswarm.common.wire.messages import ModelHeader, from_json
from jouleswarm.common.wire.models import check_weights
from jouleswarm.common.wire.tensorfile import decode_floats, encode_tensors
from jouleswarm.common.wire.types import Array, Payload


class Input(BaseModel):
    """From what the environment shows to the network's input. Of images: any height and width will do."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    observation: Observation | None = Field(None, description="as the environment shows it")
    shape: tuple[int, ...] | None = Field(None, description="of the network's input, without the batch")
    height: int | None = Field(None, description="of an image")
    width: int | None = None
    channels: tuple[str, ...] | None = None
    resize: Literal["area"] | None = Field(None, description="averages over areas, as cv2.INTER_AREA")
    subtract: float = Field(description="from every value, after resizing; then divide")
    divide: float
    layout: Literal["NCHW", "one-hot", "flat"] = Field(
        "NCHW", description="NCHW: images, channels first; one-hot: of one number; flat: as it is"
    )
    dtype: Literal["float32"] = "float32"


class Layer(BaseModel):
    """One module of a torch.nn.Sequential; its place is the first part of its tensors' names."""

    model_config = ConfigDict(frozen=True, extra="forbid", populate_by_name=True)

    layer: str = Field(description="conv2d, relu, flatten, linear, or the name of another module")
    inputs: int | None = Field(None, alias="in")
    outputs: int | None = Field(None, alias="out")
    kernel: int | None = None
    stride: int | None = None
    module: str | None = Field(None, description="another module as PyTorch prints it")


class Evaluation(BaseModel):
    """The greedy episode behind the robot's entry in `rewards`: its discounted return, as the environment judges it."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    start: Literal["entry"] = "entry"
    discount: float
    noise: dict[str, Any] | None = Field(
        None, description="state of the environment's random generator before its reset"
    )
    seed: int | None = Field(None, description="of its reset, in place of the state")


class SavedModelHeader(ModelHeader):
    """Metadata of a model that is handed in."""

    input: Annotated[Input | None, BeforeValidator(from_json)] = None
    network: Annotated[tuple[Layer, ...] | None, BeforeValidator(from_json)] = None
    actions: Annotated[tuple[str, ...] | None, BeforeValidator(from_json)] = Field(
        None, description="what the network's values are of, in their order; the greatest is taken"
    )
    heads: Annotated[tuple[int, ...] | None, BeforeValidator(from_json)] = Field(
        None, description="tasks with a last layer of their own, named task<id>/...; the network's is their mean"
    )
    evaluation: Annotated[Evaluation | None, BeforeValidator(from_json)] = None


class Use(BaseModel):
    """What a network is used with, whatever its weights are."""

    model_config = ConfigDict(frozen=True)

    input: Input
    network: tuple[Layer, ...]
    actions: tuple[str, ...]


def encode_saved_model(
    tensors: Mapping[str, Array],
    header: ModelHeader,
    use: Use,
    evaluation: Evaluation | None = None,
    heads: tuple[int, ...] = (),
) -> bytes:
    """A float32 model as a safetensors file that says how it is used."""
    fields = {name: getattr(header, name) for name in type(header).model_fields}
    fields |= {"input": use.input, "network": use.network, "actions": use.actions}
    saved = SavedModelHeader.model_construct(**fields, heads=heads or None, evaluation=evaluation)
    return encode_tensors(tensors, saved, 0)


def check_model(payload: Payload) -> SavedModelHeader:
    """The header of a float32 model of whatever shape, for who only keeps it.

    Raises:
        PayloadError: not a safetensors file with a model's metadata, or values that no receiver would take.
    """
    return _read(payload)[1]


def read_saved_model(payload: Payload) -> dict[str, Array]:
    """The tensors of a model that was handed in.

    Raises:
        PayloadError: as `check_model`.
    """
    return _read(payload)[0]


def _read(payload: Payload) -> tuple[dict[str, Array], SavedModelHeader]:
    tensors, header = decode_floats(payload, SavedModelHeader, "model")
    for name, tensor in tensors.items():
        check_weights(name, tensor)
    return tensors, header
