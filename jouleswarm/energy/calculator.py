"""The calculator: rows of somebody's own experiment become facts, which price lists know. Pure.

What was counted is taken as it stands. What was not is worked out from rounds, sizes and links by eqs. (9) and (11):
in an arm's phase in which bytes (gradients) were counted, none are worked out.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import permutations

from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.wire.names import client_of
from jouleswarm.common.wire.topics import Link
from jouleswarm.energy.arm_rows import ArmRows
from jouleswarm.energy.facts import STAGE, Counts, Facts, Flow, Phase, Work
from jouleswarm.energy.rows import Row

ALONE = "experiment"
"""The arm where none is named."""
_DONE = ("plain", "exact", "motions", "evaluation_motions")
_LINKS = {"uplink": Link.UPLINK, "downlink": Link.DOWNLINK, "sidelink": Link.SIDELINK}


def arms_of(rows: Iterable[Row]) -> list[str]:
    """Names of the arms in their order."""
    return list(dict.fromkeys(row.arm for row in rows if row.arm)) or [ALONE]


def robots_of(rows: Sequence[Row]) -> set[int]:
    """Numbers of all robots: those that rows name, and of clusters, numbered from 1 in the order of the tasks."""
    named = {each for row in rows for each in (row.robot, row.to) if each}
    arms = [ArmRows(rows, arm) for arm in arms_of(rows)]
    return named.union(*(arm.robots for arm in arms if arm.has_clusters))


def facts_of(rows: Sequence[Row], *, by_robot: bool = False) -> dict[str, Facts]:
    """What each arm has done.

    Args:
        rows: of `rows.read_rows`.
        by_robot: whether it matters who did something; else what nobody is named for is booked for robot 1.

    Raises:
        ConfigurationError: it matters and is not told, or a row names a robot that its arm does not have.
    """
    return {arm: _facts(ArmRows(rows, arm), by_robot) for arm in arms_of(rows)}


def seen_of(rows: Sequence[Row], arm: str) -> list[int]:
    """Tasks that an arm's stage before was learned from."""
    held = ArmRows(rows, arm)
    return [task for task in held.tasks if held.of("seen", task)]


def _facts(arm: ArmRows, by_robot: bool) -> Facts:
    if lacking := _lacking(arm):
        raise ConfigurationError(f"arm {arm.name}: {lacking}")
    for row in arm.counted:
        _check(arm, row, by_robot)
    work = _by_place([*_closed_work(arm), *_counted_work(arm)])
    closed, sent = _closed_flows(arm, by_robot)
    flows, known = [*closed, *_counted_flows(arm, delivered=True)], [*sent, *_counted_flows(arm, delivered=False)]
    training = arm.told("training_robots")
    return Facts(
        arm=arm.name,
        method="maml" if arm.of("t0") else "fl",
        t0=arm.of("t0"),
        parts=_parts(work, flows, known),
        rounds={task: arm.rounds(task) for task in arm.tasks},
        robots={task: len(cluster) for task, cluster in arm.clusters.items()},
        links={task: int(arm.of("links", task)) for task in arm.tasks},
        training_robots=int(training) if training and arm.of("t0") else None,
        known_flows=tuple(flows),
        known_work=tuple(work),
        known_sent=tuple(known),
    )


def _lacking(arm: ArmRows) -> str:
    """What has to be told before anything comes of what is; "" if nothing: no joules are not a bill of 0 J."""
    phases, untold = (
        {row.phase for row in arm.counted},
        [task for task in arm.tasks if arm.told("rounds", task) is None],
    )
    if untold and not arm.counted:
        return f"no rounds of task {untold[0]}, expected them, or what was counted"
    sized = any(arm.of(what, task) for what in ("batches", "model_bytes") for task in arm.tasks)
    if not untold and "fl" not in phases and not sized:
        return "rounds alone cost nothing, expected batches or model_bytes beside them, or what was counted"
    if arm.of("t0") and "ml" not in phases and not arm.of("training_robots"):
        return "t0 alone costs nothing, expected training_robots beside it, or what was counted in phase ml"
    return ""


def _check(arm: ArmRows, row: Row, by_robot: bool) -> None:
    """Raises ConfigurationError where a row's robot is told and is none, or has to be told and is not."""
    for end in (row.robot, row.to):
        if end and arm.has_clusters and end not in arm.robots:
            told = f"arm {arm.name} has robots 1 to {len(arm.robots)}"
            raise ConfigurationError(f"{row.where}: robot {end} does not exist: {told}")
    is_center = row.what == "query_gradients" or (row.what == "gradients" and row.phase == "ml")
    is_open = row.robot is None or (row.to is None and row.what in ("sidelink_bytes", "sidelink_messages"))
    if by_robot and is_open and not is_center:
        raise ConfigurationError(
            f"{row.where}: {row.what} of nobody in particular, and constants are by robot or link: expected robot"
            f"{' and to' if row.what.startswith('sidelink') else ''}"
        )


def _closed_work(arm: ArmRows) -> Iterator[Work]:
    """Eqs. (9) and (11): t0 sum of B^(a) + B^(b), and t_i B_i of each robot."""
    t0 = arm.of("t0")
    if t0 and not arm.counts("ml", "gradients"):
        each = t0 * arm.of("training_robots")
        yield Work("ml", STAGE, 0, each * arm.of("support_batches"), each * arm.of("query_batches"), 0.0, t0)
    for task, cluster in arm.clusters.items():
        rounds, batches = arm.of("rounds", task), arm.of("batches", task)
        if rounds and batches and not arm.counts("fl", "gradients"):
            for robot in cluster:
                yield Work("fl", task, robot, rounds * batches, 0, 0.0, rounds)


def _closed_flows(arm: ArmRows, by_robot: bool) -> tuple[list[Flow], list[Flow]]:
    """Eqs. (9) and (11): t0 b(E) up and b(W) down to each robot; t_i b(W) over each link, or up and down. Delivered,
    and sent over sidelinks once."""
    flows, sent, t0 = [], [], arm.of("t0")
    if t0 and not arm.counts("ml", "_bytes"):
        trained, size = int(arm.of("training_robots")), arm.of("experience_bytes")
        if by_robot and trained * size:
            raise ConfigurationError(
                f"arm {arm.name}: constants are by robot or link, and training_robots does not tell which: expected "
                "uplink_bytes of phase ml by robot, and downlink_bytes"
            )
        flows += [_flow("ml", STAGE, "uplink", robot, 0, t0, t0 * size) for robot in range(1, trained + 1) if size]
        size = arm.of("model_bytes")
        flows += [_flow("ml", STAGE, "downlink", 0, robot, 1, size) for robot in arm.robots if size]
    for task, cluster in arm.clusters.items():
        rounds, size = arm.of("rounds", task), arm.of("model_bytes", task)
        moved = rounds * size
        if not moved or arm.counts("fl", "_bytes"):
            continue
        if (links := arm.told("links", task)) is None:
            flows += [_flow("fl", task, "uplink", robot, 0, rounds, moved) for robot in cluster]
            flows += [_flow("fl", task, "downlink", 0, robot, rounds, moved) for robot in cluster]
        elif links:
            edges = _edges(arm, cluster, int(links), by_robot)
            share = links / len(edges)
            flows += [_flow("fl", task, "sidelink", *edge, share * rounds, share * moved) for edge in edges]
            sent += [_flow("fl", task, "sidelink", robot, None, rounds, moved) for robot in cluster]
    return flows, sent


def _edges(arm: ArmRows, cluster: Sequence[int], links: int, by_robot: bool) -> list[tuple[int, int]]:
    """Who sends to whom: everybody to everybody, or a ring, where so many links are that; else it must not matter."""
    size = len(cluster)
    if links > size * (size - 1):
        raise ConfigurationError(
            f"arm {arm.name}: {links} links between {size} robots, expected {size * (size - 1)} at most"
        )
    if links == size * (size - 1):
        return list(permutations(cluster, 2))
    if by_robot and links != 2 * size:
        raise ConfigurationError(
            f"arm {arm.name}: constants are by robot or link, and {links} links between {size} robots are neither all "
            "nor a ring: expected sidelink_bytes by robot and to"
        )
    ring = list(zip(cluster, [*cluster[1:], cluster[0]], strict=True))
    return [*ring, *((receiver, sender) for sender, receiver in ring)]


def _counted_work(arm: ArmRows) -> Iterator[Work]:
    """Gradients and motions as they were counted."""
    for row in arm.counted:
        place: dict[str, float] = dict.fromkeys(_DONE, 0.0)
        name = {"gradients": "plain", "query_gradients": "exact"}.get(row.what, row.what)
        if name not in place:
            continue
        of_center = row.what == "query_gradients" or (row.what == "gradients" and row.phase == "ml")
        who = [row.robot] if row.robot is not None else [0] if of_center else arm.cluster(row.task)
        for robot in who:
            found = place | {name: row.value / len(who)}
            rounds = arm.rounds(row.task) if row.phase == "fl" else arm.of("t0")
            yield Work(row.phase, arm.place(row), robot, seconds=0.0, rounds=rounds, **found)


def _by_place(work: Iterable[Work]) -> list[Work]:
    """Work of several rows as one: each has the rounds of the whole."""
    sums: dict[tuple[Phase, int, int], Work] = {}
    for each in work:
        if (held := sums.get(each[:3])) is not None:
            done = {name: getattr(held, name) + getattr(each, name) for name in _DONE}
            each = held._replace(rounds=max(held.rounds, each.rounds), **done)
        sums[each[:3]] = each
    return list(sums.values())


def _counted_flows(arm: ArmRows, *, delivered: bool) -> Iterator[Flow]:
    """Bytes and messages as they were counted: those delivered; or those sent over sidelinks once, which are as many
    where none are told."""
    rows = [row for row in arm.counted if row.what.endswith(("_bytes", "_messages"))]
    told = {row.phase for row in rows if row.what == "sidelink_sent_bytes"}
    beside = {(row.what, row.phase, row.task, row.robot, row.to) for row in rows}
    sums: dict[tuple[Phase, int, str, int | None, int | None], list[float]] = {}
    for row in rows:
        link, kind = row.what.split("_")[0], row.what.split("_", 1)[1]
        once = kind == "sent_bytes"
        if once if delivered else not (once or (link == "sidelink" and row.phase not in told)):
            continue
        found = sums.setdefault((row.phase, arm.place(row), link, row.robot, row.to), [0.0, 0.0])
        found[kind.endswith("bytes")] += row.value
        if kind == "messages" and (f"{link}_bytes", row.phase, row.task, row.robot, row.to) not in beside:
            raise ConfigurationError(f"{row.where}: {row.what} without {link}_bytes of the same, expected both")
    for (phase, task, link, robot, to), (messages, payload) in sums.items():
        who = [robot] if robot is not None else arm.cluster(task or None)
        for place, one in enumerate(who):
            other = to or (who[(place + 1) % len(who)] if len(who) > 1 else one + 1)
            ends = {"uplink": (one, 0), "downlink": (0, one), "sidelink": (one, other if delivered else None)}[link]
            yield _flow(phase, task, link, *ends, messages / len(who), payload / len(who))


def _flow(
    phase: Phase, task: int, link: str, sender: int, receiver: int | None, messages: float, payload: float
) -> Flow:
    to = "" if receiver is None else client_of(receiver)
    return Flow(phase, task, _LINKS[link], client_of(sender), to, messages, payload, payload)


def _parts(work: Sequence[Work], flows: Sequence[Flow], sent: Sequence[Flow]) -> Mapping[tuple[Phase, int], Counts]:
    """The sums by phase and task."""
    parts: dict[tuple[Phase, int], Counts] = {}
    found = [((each.phase, each.task), _of_work(each)) for each in work]
    found += [((flow.phase, flow.task), Counts(**{f"{flow.link}_bytes": flow.payload_bytes})) for flow in flows]
    found += [((flow.phase, flow.task), Counts(sidelink_sent_bytes=flow.payload_bytes)) for flow in sent]
    for key, counts in found:
        parts[key] = parts.get(key, Counts()) + counts
    return parts


def _of_work(work: Work) -> Counts:
    if work.robot:
        return Counts(gradients_robots=work.plain + work.exact)
    return Counts(gradients_support=work.plain, gradients_query=work.exact)
