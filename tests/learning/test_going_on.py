"""What learns and encodes is written to a file, read into a new object, and goes on bit by bit the same."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from jouleswarm.codecs.codec import Codec
from jouleswarm.codecs.floats import FLOAT32, Float16
from jouleswarm.codecs.int8 import Int8
from jouleswarm.codecs.streams import WeightsDecoder, WeightsEncoder
from jouleswarm.codecs.topk import TopK
from jouleswarm.common.disk.state import State, Stateful
from jouleswarm.common.disk.statefile import StateFile
from jouleswarm.common.errors import RunError
from jouleswarm.common.scenario.sections import Learning, Network
from jouleswarm.common.scenario.spaces import Observation
from jouleswarm.common.wire.messages import ModelHeader
from jouleswarm.common.wire.models import encode_model
from jouleswarm.learning.learner import Learner, Policy
from jouleswarm.learning.networks import shapes_of, to_weights
from jouleswarm.learning.replay import Replay
from jouleswarm.methods.ledger import RewardLedger
from tests.made_up import image, qnetwork

NETWORK = Network(width=16, height=12, conv=((8, 4, 2), (16, 3, 1)), dense=(32,))
CODECS = [FLOAT32, Float16(), Int8(), TopK(0.1)]
Weights = dict[str, Any]


def through_a_file(ours: Stateful, theirs: Any, folder: Path) -> None:
    """Bring `theirs` to where `ours` is."""
    file = StateFile(folder / "s.safetensors", "o")
    file.save(ours.state())
    state = file.load()
    assert state is not None
    theirs.load_state(state)


def start(seed: int = 1) -> Weights:
    return to_weights(qnetwork(NETWORK, seed))


def one_round(learner: Learner, rng: np.random.Generator) -> None:
    for _ in range(5):
        learner.replay.observe(rng.integers(0, 256, (12, 16, 4), dtype=np.uint8), first=bool(rng.random() < 0.3))
        learner.replay.act(int(rng.integers(4)), float(rng.normal()), terminated=bool(rng.random() < 0.2))
    learner.learn(4)


def assert_same(ours: State, theirs: State) -> None:
    assert ours.values == theirs.values
    assert ours.arrays.keys() == theirs.arrays.keys()
    assert all(np.array_equal(array, theirs.arrays[name]) for name, array in ours.arrays.items())


@pytest.mark.parametrize("optimizer", ["adam", "sgd"])
@pytest.mark.parametrize("double", [True, False])
def test_a_learner_goes_on_bit_by_bit(optimizer: str, double: bool, tmp_path: Path) -> None:
    settings = Learning.model_validate(
        {"optimizer": optimizer, "lr": 1e-2, "batch_size": 4, "replay_size": 12, "double": double, "target_every": 3}
    )

    def learner(seed: int, file: Path) -> Learner:
        return Learner(qnetwork(NETWORK), settings, start(seed), np.random.default_rng(seed), file)

    (tmp_path / "copy").mkdir()
    undisturbed = learner(1, tmp_path / "a.bin")
    for round_ in range(3):  # 15 frames: the ring of 12 is full
        one_round(undisturbed, np.random.default_rng(round_))
    shutil.copy(tmp_path / "a.bin", tmp_path / "copy")
    back = learner(2, tmp_path / "copy" / "a.bin")
    through_a_file(undisturbed, back, tmp_path)
    for round_ in range(3, 6):
        for each in (undisturbed, back):
            one_round(each, np.random.default_rng(round_))
        assert_same(back.state(), undisturbed.state())
    assert back.steps == 24


def test_a_learner_that_has_not_learned_yet_goes_on_too(tmp_path: Path) -> None:
    settings = Learning(batch_size=4, replay_size=12)
    undisturbed = Learner(qnetwork(NETWORK), settings, start(1), np.random.default_rng(1), tmp_path / "a.bin")
    back = Learner(qnetwork(NETWORK), settings, start(2), np.random.default_rng(2), tmp_path / "b.bin")
    through_a_file(undisturbed, back, tmp_path)
    for each in (undisturbed, back):
        one_round(each, np.random.default_rng(0))
    assert_same(back.state(), undisturbed.state())


def test_a_policy_goes_on(tmp_path: Path) -> None:
    ours, theirs = Policy(qnetwork(NETWORK), start(1)), Policy(qnetwork(NETWORK), start(2))
    through_a_file(ours, theirs, tmp_path)
    assert_same(theirs.state(), ours.state())


def frame(value: int) -> Any:
    return np.full((1, 1, 4), value, np.uint8)


def test_a_replay_memory_goes_on_from_its_state_and_its_frames_in_a_file(tmp_path: Path) -> None:
    ours = Replay(3, image(1, 1), tmp_path / "deep" / "frames.bin")
    for value in (10, 20, 30, 40):  # 40 takes the place of 10
        ours.observe(frame(value), first=False)
        ours.act(value % 4, float(value), terminated=False)
    state = ours.state()
    theirs = Replay(3, image(1, 1), tmp_path / "deep" / "frames.bin")
    theirs.load_state(state)
    theirs.observe(frame(50), first=False)  # the ring is now 40, 50, 30
    batch = theirs.sample(100, np.random.default_rng(1))
    assert set(zip(batch.frames[:, 0, 0, 0].tolist(), batch.rewards.tolist(), strict=True)) == {(30, 30.0), (40, 40.0)}
    assert set(batch.next_frames[:, 0, 0, 0].tolist()) == {40, 50}


@pytest.mark.parametrize(
    "keeps",
    [
        Observation(shape=(), dtype="int64", values=100),
        Observation(shape=(3,), dtype="float64"),
        Observation(shape=(2, 2), dtype="bool"),
        Observation(shape=(2, 1, 3), dtype="uint8"),
    ],
    ids=str,
)
def test_a_memory_of_anything_goes_on_from_its_file_with_its_checksums(keeps: Observation, tmp_path: Path) -> None:
    ours = Replay(3, keeps, tmp_path / "frames.bin", 2)
    for value in (10, 20, 30, 40):
        ours.observe(np.full(keeps.shape, value, keeps.dtype), first=False)
        ours.act(0, float(value), terminated=False)
    file = StateFile(tmp_path / "s", "o")
    file.save(ours.state())
    state, theirs = file.load(), Replay(3, keeps, tmp_path / "frames.bin", 2)
    assert state is not None
    theirs.load_state(state)
    drawn = [each.sample(40, np.random.default_rng(1)) for each in (ours, theirs)]
    assert drawn[0].frames.dtype == keeps.dtype
    assert all(a.tobytes() == b.tobytes() for a, b in zip(*drawn, strict=True))
    expected = [np.full(keeps.shape, value, keeps.dtype).tolist() for value in drawn[1].rewards.astype(int)]
    assert drawn[1].frames.tolist() == expected


class Killed(BaseException):
    """In place of a kill -9."""


ROUND, RING = 3, 5  # frames: the ring has wrapped in the second round
SAVED, MORE = 4, 8  # rounds before the kill, and all of them


def play(replay: Replay, round_: int, frames: int = ROUND) -> bytes:
    """The frames of a round, and what is learned from then."""
    for motion in range(frames):
        value = ROUND * round_ + motion
        replay.observe(frame(value), first=motion == 0 and round_ % 3 == 0)
        replay.act(value % 4, float(value), terminated=motion == 2 and round_ % 2 == 0)
    return b"".join(part.tobytes() for part in replay.sample(40, np.random.default_rng(round_)))


@pytest.fixture(scope="module")
def undisturbed() -> list[bytes]:
    replay = Replay(RING, image(1, 1))
    return [play(replay, round_) for round_ in range(MORE)]


def killed(folder: Path, frames: int, share: float | None, patch: pytest.MonkeyPatch) -> None:
    """A robot that has saved some rounds, and is killed after so many frames of the next, or so much of its state."""
    replay, file = Replay(RING, image(1, 1), folder / "frames.bin", ROUND), StateFile(folder / "s", "o")
    for round_ in range(SAVED):
        play(replay, round_)
        file.save(replay.state())
    play(replay, SAVED, frames)
    if share is None:
        return

    def write(file: Any, content: bytes) -> None:
        file.write(content[: int(share * len(content))])
        raise Killed

    with patch.context() as dying:
        dying.setattr("jouleswarm.common.disk.statefile._write_all", write)
        with pytest.raises(Killed):
            file.save(replay.state())


@pytest.mark.parametrize(("frames", "share"), [*((frames, None) for frames in range(4)), (3, 0), (3, 0.5), (3, 1)])
def test_a_kill_at_any_moment_leaves_a_wrapped_replay_memory_as_its_newest_whole_state_tells(
    frames: int, share: float | None, tmp_path: Path, undisturbed: list[bytes], monkeypatch: pytest.MonkeyPatch
) -> None:
    killed(tmp_path, frames, share, monkeypatch)
    back, saved = Replay(RING, image(1, 1), tmp_path / "frames.bin", ROUND), StateFile(tmp_path / "s", "o").load()
    assert saved is not None
    back.load_state(saved)
    assert [play(back, round_) for round_ in range(SAVED, MORE)] == undisturbed[SAVED:]


@pytest.mark.parametrize("place", range(RING + ROUND))
def test_a_frame_that_is_not_as_it_was_written_is_refused(
    place: int, tmp_path: Path, undisturbed: list[bytes], monkeypatch: pytest.MonkeyPatch
) -> None:
    killed(tmp_path, 1, None, monkeypatch)
    file = tmp_path / "frames.bin"
    content = bytearray(file.read_bytes())
    content[4 * place + 1] ^= 4
    file.write_bytes(content)
    # 12 frames were saved in 8 places: 7 to 11 are remembered, at 7, 0, 1, 2 and 3.
    if place in (7, 0, 1, 2, 3):
        with pytest.raises(RunError, match=rf"^{file}: .*altered in block {place + 1} of 8"):
            StateFile(tmp_path / "s", "o").load()
    else:
        assert StateFile(tmp_path / "s", "o").load() is not None


def test_frames_have_their_place_on_the_disk_before_there_are_any(tmp_path: Path) -> None:
    Replay(1000, image(10, 10), tmp_path / "frames.bin")
    assert (tmp_path / "frames.bin").stat().st_blocks * 512 >= 1000 * 10 * 10 * 4


def test_a_reward_ledger_goes_on_with_exact_rewards(tmp_path: Path) -> None:
    ours, theirs = (RewardLedger((1, 12), 2, window=3) for _ in range(2))
    for round_, reward in enumerate((0.1, 1 / 3, -1e-300), start=1):
        ours.record(1, round_, reward)
        ours.merge({12: (round_, reward + 1)})
    through_a_file(ours, theirs, tmp_path)
    for ledger in (ours, theirs):
        ledger.record(1, 4, 5.0)
        ledger.merge({12: (4, 6.0)})
    assert theirs.newest() == ours.newest() == {1: (4, 5.0), 12: (4, 6.0)}
    assert theirs.cluster_reward(4) == ours.cluster_reward(4)  # of rounds 1 to 3
    assert ours.cluster_reward(4) == pytest.approx((2 * (0.1 + 1 / 3) + 3) / 6)


@pytest.mark.parametrize("codec", CODECS, ids=lambda codec: codec.name)
def test_an_encoder_and_its_decoder_go_on_with_the_same_messages(codec: Codec, tmp_path: Path) -> None:
    rng, model = np.random.default_rng(1), start()
    shapes = shapes_of(qnetwork(NETWORK))
    encoder, decoder = WeightsEncoder(codec), WeightsDecoder(codec, shapes)

    def moved(weights: Weights) -> Weights:
        return {name: tensor + rng.normal(0, 0.1, tensor.shape).astype(np.float32) for name, tensor in weights.items()}

    for _ in range(2):
        model = moved(model)
        decoder.decode(encoder.encode(model))
    encoder_back, decoder_back = WeightsEncoder(codec), WeightsDecoder(codec, shapes)
    through_a_file(encoder, encoder_back, tmp_path)
    through_a_file(decoder, decoder_back, tmp_path)
    header = ModelHeader(task=1, agent=1, round=3)
    for _ in range(2):
        model = moved(model)
        ours, theirs = encoder.encode(model), encoder_back.encode(model)
        assert encode_model(theirs, header) == encode_model(ours, header)
        held, held_back = decoder.decode(ours), decoder_back.decode(theirs)
        assert all(np.array_equal(held[name], held_back[name]) for name in shapes)


@pytest.mark.parametrize("codec", CODECS, ids=lambda codec: codec.name)
def test_an_encoder_that_has_said_nothing_yet_says_a_whole_model_first(codec: Codec, tmp_path: Path) -> None:
    ours, theirs = WeightsEncoder(codec), WeightsEncoder(codec)
    through_a_file(ours, theirs, tmp_path)
    header = ModelHeader(task=1, agent=1, round=1)
    assert theirs.payload(start(), header) == ours.payload(start(), header)
