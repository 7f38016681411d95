"""All studies by name."""

from __future__ import annotations

from jouleswarm.common.errors import StudyError
from jouleswarm.studies.codecs import KIND as CODECS
from jouleswarm.studies.experience import KIND as EXPERIENCE
from jouleswarm.studies.kinds import Kind
from jouleswarm.studies.paper_study import KIND as PAPER
from jouleswarm.studies.point_studies import BASELINES, REGIMES, SENSITIVITY
from jouleswarm.studies.similarity import KIND as SIMILARITY

_ALL = (PAPER, BASELINES, SENSITIVITY, REGIMES, SIMILARITY, CODECS, EXPERIENCE)
KINDS: dict[str, Kind] = {kind.name: kind for kind in _ALL}


def kind_of(name: str) -> Kind:
    """The study called `name`.

    Raises:
        StudyError: there is none.
    """
    if name not in KINDS:
        raise StudyError(f"got a study called {name!r}, expected one of {', '.join(KINDS)}")
    return KINDS[name]
