"""Which faults are planned, and which count as survived."""

from __future__ import annotations

import pytest

from jouleswarm.chaos.faults import KINDS, FaultKind
from jouleswarm.chaos.plan import PHASES, Fault, plan_faults


def test_the_first_faults_are_one_of_every_kind() -> None:
    few = plan_faults(len(KINDS), KINDS, has_meta=True)
    # Some kinds make no sense in the phase whose turn it is: theirs come with the next turn.
    assert len({fault.kind for fault in few}) >= len(KINDS) - 4
    assert {fault.phase for fault in few} == {*PHASES}


def test_every_kind_comes_in_every_phase_in_which_it_makes_sense() -> None:
    planned = {(fault.kind, fault.phase) for fault in plan_faults(100, KINDS, has_meta=True)}
    assert {phase for kind, phase in planned if kind == "robot killed"} == {*PHASES}
    assert {phase for kind, phase in planned if kind == "broker killed"} == {*PHASES}
    assert {phase for kind, phase in planned if kind == "state torn"} == {*PHASES}
    assert {phase for kind, phase in planned if kind == "run interrupted"} == {*PHASES}
    assert {phase for kind, phase in planned if kind == "state lost"} == {"meta-learning", "federated", "leaving"}
    assert {phase for kind, phase in planned if kind == "disk full"} == {"meta-learning", "federated"}
    assert {kind for kind, _ in planned} == {*KINDS}


def test_without_meta_learning_there_is_no_fault_of_it() -> None:
    planned = plan_faults(100, KINDS, has_meta=False)
    assert "meta-learning" not in {fault.phase for fault in planned}
    assert "data center killed" not in {fault.kind for fault in planned}


@pytest.mark.parametrize(
    ("kind", "note", "identical", "is_survived"),
    [
        ("robot killed", "", True, True),
        ("robot killed", "", False, False),
        ("state lost", "refused", True, True),
        ("state lost", "NOT refused", True, False),
        ("disk full", "", True, False),  # nobody has noticed it
        ("disk full", "NOT told: it printed nothing", True, False),
        ("same run twice", "refused", True, True),
        ("same run twice", "refused", False, False),
    ],
)
def test_what_must_be_noticed_is_not_survived_in_silence(
    kind: FaultKind, note: str, identical: bool, is_survived: bool
) -> None:
    assert Fault(kind, "federated", note=note, identical=identical, conserved=True).is_survived is is_survived
