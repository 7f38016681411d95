"""Topics: what they look like, and what is read from them."""

import pytest

from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.wire import topics
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
}


@pytest.mark.parametrize("topic", METERED)
def test_a_topic_says_its_link_run_arm_and_phase(topic: str) -> None:
    written, link, phase = METERED[topic]
    assert topic == written
    assert topics.link_of(topic) == link
    assert topics.phase_of(topic) == phase
    assert topics.run_of(topic) == "r"
    assert topics.arm_of(topic) == written.split("/")[2]


def test_all_topics_of_a_run_differ() -> None:
    assert len(METERED) == 15


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
        topics.meter_report("r", "agent-3"),
        "jouleswarm/r/maml/xx/2/3/weights",
        "elsewhere/r/maml/sl/2/3/weights",
        "$SYS/broker/bytes/sent",
        "jouleswarm/r/maml/sl",
        "",
    ],
)
def test_reports_and_foreign_topics_are_not_metered(topic: str) -> None:
    assert topics.link_of(topic) is None
    assert topics.phase_of(topic) == "control"
