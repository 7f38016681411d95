"""Topics: what they look like, and what is read from them, or said of them by the product's rules."""

import inspect

import pytest

from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.wire import links, topics
from jouleswarm.common.wire.topics import Link

METERED = {
    topics.experience("r", "maml", 2, 3): ("jouleswarm/r/maml/ul/2/3/experience", Link.UPLINK, "maml"),
    topics.transition("r", "centralized", 2, 3): ("jouleswarm/r/centralized/ul/2/3/transition", Link.UPLINK, "fl"),
    topics.weights_up("r", "fedavg", 2, 3): ("jouleswarm/r/fedavg/ul/2/3/weights", Link.UPLINK, "fl"),
    topics.cluster_model("r", "mine", 2): ("jouleswarm/r/mine/dl/2/model", Link.DOWNLINK, "fl"),
    topics.meta_model("r", "maml"): ("jouleswarm/r/maml/dl/meta", Link.DOWNLINK, "maml"),
    topics.meta_model("r", "maml", 3): ("jouleswarm/r/maml/dl/3/meta", Link.DOWNLINK, "maml"),
    topics.weights("r", "fl", 2, 3): ("jouleswarm/r/fl/sl/2/3/weights", Link.SIDELINK, "fl"),
    topics.resend("r", "maml", 2, 3): ("jouleswarm/r/maml/ctl/2/3/resend", Link.CONTROL, "control"),
    topics.collect_again("r", "maml", 2, 3): ("jouleswarm/r/maml/ctl/2/3/collect", Link.CONTROL, "control"),
    topics.meta_round("r", "maml"): ("jouleswarm/r/maml/ctl/meta/round", Link.CONTROL, "control"),
    topics.meta_resend("r", "maml"): ("jouleswarm/r/maml/ctl/meta/resend", Link.CONTROL, "control"),
    topics.presence("r", 2, 3): ("jouleswarm/r/all/ctl/2/3/presence", Link.CONTROL, "control"),
    topics.telemetry("r", "maml", "agent-3"): ("jouleswarm/r/maml/tlm/agent-3/round", Link.CONTROL, "control"),
    topics.learned("r", "maml", 2): ("jouleswarm/r/maml/tlm/2/learned", Link.CONTROL, "control"),
    topics.snapshot("r", "maml", 42): ("jouleswarm/r/maml/tlm/42/snapshot", Link.CONTROL, "control"),
    topics.episode("r", "centralized", 2, 3): ("jouleswarm/r/centralized/ctl/2/3/episode", Link.CONTROL, "control"),
    topics.model_again("r", "fedavg", 2): ("jouleswarm/r/fedavg/ctl/2/0/again", Link.CONTROL, "control"),
    topics.claim("r", 2, 3): ("jouleswarm/r/all/ctl/2/3/claim", Link.CONTROL, "control"),
}
UNMETERED = {
    topics.broker_answer("a"): "$SYS/jouleswarm/meter/a",
    topics.meter_report("r", "agent-3"): "jouleswarm/r/meter/agent-3",
    topics.recorder("r"): "jouleswarm/r/meter/recorder/here",
    topics.acknowledgement("r", "agent-3"): "jouleswarm/r/meter/agent-3/ack",
    topics.probe("r"): "jouleswarm/r/meter/recorder/probe",
    topics.scenario("r", "agent-3"): "jouleswarm/r/meter/agent-3/scenario",
    topics.wait("r", "agent-3"): "jouleswarm/r/meter/agent-3/wait",
}
READERS = {"run_name", "run_of", "arm_of", "task_of", "agent_of"}


@pytest.mark.parametrize("topic", METERED)
def test_a_topic_says_its_link_run_arm_and_phase(topic: str) -> None:
    written, link, phase = METERED[topic]
    assert topic == written
    assert links.link_of(topic) == link
    assert links.phase_of(topic) == phase
    assert topics.run_of(topic) == "r"
    assert topics.arm_of(topic) == written.split("/")[2]


def test_the_rules_are_held_against_every_topic_that_the_code_makes() -> None:
    made = {name for name, each in vars(topics).items() if inspect.isfunction(each)} - READERS
    made_twice = {"meta_model"}  # for all robots, and for one
    assert len(METERED) + len(UNMETERED) == len(made) + len(made_twice), "and all of them differ"


@pytest.mark.parametrize("name", ["toy", "toy-20240501-120000-ab12", "a.b", "_", "7"])
def test_a_run_name_is_a_level_of_a_topic_and_a_directory(name: str) -> None:
    assert topics.run_name(name) == name


@pytest.mark.parametrize("name", ["", "a/b", "+", "#", "a#", ".", "..", ".hidden", "a b", "é", "a\n", "a\0"])
def test_other_run_names_are_refused(name: str) -> None:
    with pytest.raises(ConfigurationError, match=r"run name .*: expected letters"):
        topics.run_name(name)


@pytest.mark.parametrize(
    "topic",
    [
        topics.BROKER_METER,
        topics.BROKER_METER_ASK,
        topics.BROKER_LIMITS,
        *UNMETERED.values(),
        "jouleswarm/r/maml/xx/2/3/weights",
        "elsewhere/r/maml/sl/2/3/weights",
        "$SYS/broker/bytes/sent",
        "jouleswarm/r/maml/sl",
        "",
    ],
)
def test_reports_and_foreign_topics_are_not_metered(topic: str) -> None:
    assert set(UNMETERED) == set(UNMETERED.values())
    assert links.link_of(topic) is None
    assert links.phase_of(topic) == "control"
