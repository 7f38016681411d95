"""The data center's memory on disk: after each round enough to go on from there, bit by bit the same."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import safetensors
import safetensors.numpy
import safetensors.torch

from common.errors import RunError
from common.payloads import MotionHeader
from datacenter.metalearner import MetaLearner
from datacenter.motions import Motion

_FINISHED = "finished"

RoundMotions = dict[int, list[list[Motion]]]


class Checkpoint:
    """A folder: one safetensors file of state, replaced each round, and one file of experience a round."""

    def __init__(self, folder: Path | None) -> None:
        self._folder = folder
        if folder is not None:
            folder.mkdir(parents=True, exist_ok=True)

    def save(self, round_: int, learner: MetaLearner, motions: RoundMotions) -> None:
        """Keep round `round_`; the state is written last, and whole or not at all."""
        if self._folder is None:
            return
        frames, headers = {}, {}
        for task, robots in motions.items():
            for index, each in enumerate(robots):
                frames[f"{task}/{index}"] = np.stack([motion.frame for motion in each])
                headers[f"{task}/{index}"] = "\n".join(motion.header.model_dump_json(by_alias=True) for motion in each)
        self._write(f"round-{round_:05d}", safetensors.numpy.save(frames, metadata=headers))
        self._write(
            "state",
            safetensors.torch.save(learner.state(), metadata={"round": str(round_), "scenario": learner.fingerprint}),
        )

    def keep_model(self, round_: int, payload: bytes) -> None:
        """Keep a meta-model that goes down when the stage is over."""
        if self._folder is not None:
            self._write(f"model-{round_:05d}", payload)

    def models(self) -> dict[int, bytes]:
        """Round -> meta-model kept, of rounds before the one that `restore` goes on from."""
        paths = sorted(self._folder.glob("model-*.safetensors")) if self._folder else []
        return {int(path.stem.removeprefix("model-")): path.read_bytes() for path in paths}

    @property
    def is_finished(self) -> bool:
        """Whether this stage was finished, and the robots have its models."""
        return self._folder is not None and (self._folder / _FINISHED).exists()

    def restore(self, learner: MetaLearner) -> int:
        """Bring `learner` to where the last whole round left it; returns that round, 0 without any.

        Raises:
            RunError: the folder holds another scenario's state.
        """
        path = self._folder / "state.safetensors" if self._folder else None
        if path is None or not path.exists():
            return 0
        try:
            with safetensors.safe_open(path, framework="pt") as file:
                metadata = file.metadata()
                if metadata["scenario"] != learner.fingerprint:
                    raise ValueError("it is another scenario's")
                round_ = int(metadata["round"])
                learner.load_state({name: file.get_tensor(name) for name in file.keys()})  # noqa: SIM118
            for past in range(1, round_ + 1):
                for task, motions in self._experience(past):
                    learner.remember(task, motions)
        except (KeyError, ValueError, RuntimeError, OSError, safetensors.SafetensorError) as error:
            raise RunError(
                f"checkpoint {self._folder}: does not fit this scenario ({error}); name another folder with --state"
            ) from error
        return round_

    def finish(self) -> None:
        """The stage is over and the meta-models are with the robots: forget all but that."""
        if self._folder is not None:
            (self._folder / _FINISHED).touch()
            for path in self._folder.glob("*.safetensors"):
                path.unlink()

    def clear(self) -> None:
        """The run is over: leave no trace."""
        if self._folder is not None:
            (self._folder / _FINISHED).unlink(missing_ok=True)
            with contextlib.suppress(OSError):  # somebody else's files may be in it
                self._folder.rmdir()

    def _experience(self, round_: int) -> Iterable[tuple[int, list[Motion]]]:
        assert self._folder is not None
        path = self._folder / f"round-{round_:05d}.safetensors"
        with safetensors.safe_open(path, framework="np") as file:
            headers = file.metadata()
            for name in sorted(file.keys(), key=lambda each: tuple(map(int, each.split("/")))):
                lines = headers[name].splitlines()
                frames = file.get_tensor(name)
                yield (
                    int(name.split("/")[0]),
                    [
                        Motion(frame, MotionHeader.model_validate_json(line))
                        for frame, line in zip(frames, lines, strict=True)
                    ],
                )

    def _write(self, name: str, content: bytes) -> None:
        assert self._folder is not None
        part = self._folder / f"{name}.part"
        with part.open("wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        part.replace(self._folder / f"{name}.safetensors")
