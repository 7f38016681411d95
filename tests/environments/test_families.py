"""Families of tasks: what holds of every one that is drawn."""

from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from jouleswarm.common.errors import StudyError
from jouleswarm.environments.landmarks.families import draw_family, drawing, similarity
from jouleswarm.environments.landmarks.maps import parse_map

SEEDS = st.integers(0, 10_000)
STEMS = st.integers(0, 6)


@settings(max_examples=60, deadline=None)
@given(SEEDS, STEMS)
def test_all_paths_share_the_stem_and_not_the_motion_after_it(seed: int, stem: int) -> None:
    family = draw_family(seed, stem)
    assert len(family) == 6
    assert len({path[: stem + 1] for path in family}) == 1
    assert len({path[stem + 1] for path in family}) > 1


@settings(max_examples=60, deadline=None)
@given(SEEDS, STEMS)
def test_every_path_is_a_walk_of_four_to_ten_motions_that_never_crosses_itself(seed: int, stem: int) -> None:
    for path in draw_family(seed, stem):
        assert path[0] == (0, 2)
        assert 4 <= len(path) - 1 <= 10
        assert len(set(path)) == len(path)
        assert all(abs(a[0] - b[0]) + abs(a[1] - b[1]) == 1 for a, b in pairwise(path))


@settings(max_examples=60, deadline=None)
@given(SEEDS, STEMS)
def test_exits_differ_and_drawings_read_back_as_the_paths(seed: int, stem: int) -> None:
    family = draw_family(seed, stem)
    assert len({path[-1] for path in family}) == 6
    assert all(parse_map(drawing(path, 8, 5), 8, 5).path == path for path in family)


@given(SEEDS, STEMS)
@settings(max_examples=10, deadline=None)
def test_the_same_seed_draws_the_same_family(seed: int, stem: int) -> None:
    assert draw_family(seed, stem) == draw_family(seed, stem)


def test_other_seeds_draw_other_families() -> None:
    assert len({draw_family(seed, 3) for seed in range(10)}) == 10


def test_families_with_a_long_stem_have_more_in_common() -> None:
    far, near = ([similarity(draw_family(seed, stem)) for seed in range(10)] for stem in (0, 6))
    assert max(far) < min(near)


def test_similarity_is_the_mean_share_of_common_landmarks_over_pairs() -> None:
    a, b, c = ((0, 0), (1, 0), (2, 0)), ((0, 0), (1, 0), (1, 1)), ((0, 0), (0, 1), (0, 2))
    # a and b: 2 of 4; a and c: 1 of 5; b and c: 1 of 5; mean of 0.5, 0.2, 0.2
    assert similarity([a, b, c]) == pytest.approx(0.3)
    assert similarity([a, a]) == 1


@pytest.mark.parametrize(
    ("stem", "tasks", "message"), [(7, 6, "0 to 6"), (-1, 6, "0 to 6"), (0, 1, "1 tasks"), (6, 40, "shorter stem")]
)
def test_a_family_that_cannot_be_is_refused(stem: int, tasks: int, message: str) -> None:
    with pytest.raises(StudyError, match=message):
        draw_family(1, stem, tasks)


def test_a_grid_too_small_for_the_paths_is_refused() -> None:
    with pytest.raises(StudyError, match="larger grid"):
        draw_family(1, 0, 6, 2, 2, (0, 0))


def test_a_single_path_has_no_similarity() -> None:
    with pytest.raises(StudyError, match="two or more"):
        similarity([((0, 0), (1, 0))])
