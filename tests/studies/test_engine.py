"""The engine with made-up jobs: what is run, what is skipped, what is told."""

from __future__ import annotations

import contextlib
import io
import os
import signal
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from pathlib import Path

import pytest
from distributed import Client, LocalCluster
from rich.console import Console

import jouleswarm.studies.cluster
import jouleswarm.studies.deployment
from jouleswarm.common.errors import RunError, StudyError
from jouleswarm.common.scenario.arms import Arm
from jouleswarm.studies.catalogue import kind_of
from jouleswarm.studies.cluster import connected
from jouleswarm.studies.engine import FACTS, collected, part_of, run_jobs
from jouleswarm.studies.facts import Fact, read_facts, write_facts
from jouleswarm.studies.jobs import Job, Request
from jouleswarm.studies.progress import Progress
from jouleswarm.studies.run import Where, run_study
from tests.studies.made_up import task_fact

ROOT = Path(__file__).parents[2]
SCENARIO = 'name = "x"\n'
PLAIN = Arm("fl", "fl", 0)


def job(seed: int, *overrides: str, variant: str = "") -> Job:
    return Job(variant, seed, SCENARIO, overrides)


def made_up(job: Job) -> list[Fact]:
    return [task_fact(PLAIN, task, 10 * job.seed + task, job.seed, job.variant) for task in (1, 2)]


class Failing:
    """Fails for seed 2."""

    def __call__(self, job: Job) -> list[Fact]:
        if job.seed == 2:
            raise RunError("agent-3 ended with code 4")
        return made_up(job)


class FailingDeployment(Failing):
    """The same in place of a deployment."""

    def __call__(self, job: Job, work: Path | None = None, keep: bool = False) -> list[Fact]:
        found = super().__call__(job)
        return found if not job.variant and job.overrides[-1] == 'methods=["fl"]' else []


class Counting:
    """Remembers, on disk, which seeds it was run with."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def __call__(self, job: Job) -> list[Fact]:
        (self.folder / str(job.seed)).touch()
        return made_up(job)


@pytest.fixture(scope="module")
def client() -> Iterator[Client]:
    with (
        LocalCluster(n_workers=1, threads_per_worker=1, processes=False, dashboard_address="127.0.0.1:0") as cluster,
        Client(cluster) as client,
    ):
        yield client


@pytest.fixture
def cluster(client: Client) -> Callable[[], AbstractContextManager[Client]]:
    return lambda: contextlib.nullcontext(client)


def no_cluster() -> AbstractContextManager[Client]:
    pytest.fail("a cluster was started with nothing to run")


def progress(output: io.StringIO | None = None) -> Progress:
    return Progress(Console(file=output or io.StringIO(), width=200), "study x")


def test_facts_of_all_jobs_are_in_the_order_of_the_jobs(cluster: Callable[..., Client], tmp_path: Path) -> None:
    jobs = [job(3), job(1), job(2)]
    assert run_jobs(jobs, made_up, tmp_path, cluster, progress()) == {}
    assert [fact.seed for fact in read_facts(tmp_path / FACTS)] == [3, 3, 1, 1, 2, 2]


def test_a_job_that_is_collected_is_not_run_again(cluster: Callable[..., Client], tmp_path: Path) -> None:
    (ran := tmp_path / "ran").mkdir()
    write_facts(part_of(tmp_path, job(1)), made_up(job(1)))
    run_jobs([job(1), job(2)], Counting(ran), tmp_path, cluster, progress())
    assert [path.name for path in ran.iterdir()] == ["2"]
    assert [fact.seed for fact in read_facts(tmp_path / FACTS)] == [1, 1, 2, 2]


def test_with_all_collected_no_cluster_is_started(tmp_path: Path) -> None:
    write_facts(part_of(tmp_path, job(1)), made_up(job(1)))
    assert run_jobs([job(1)], made_up, tmp_path, no_cluster, progress()) == {}
    assert read_facts(tmp_path / FACTS) == made_up(job(1))


def test_a_job_that_fails_is_named_and_the_others_go_on(cluster: Callable[..., Client], tmp_path: Path) -> None:
    output = io.StringIO()
    failed = run_jobs([job(seed) for seed in (1, 2, 3)], Failing(), tmp_path, cluster, progress(output))
    assert list(failed) == [job(2).name]
    assert str(failed[job(2).name]) == "agent-3 ended with code 4"
    assert [fact.seed for fact in collected(tmp_path, [job(1), job(2), job(3)])] == [1, 1, 3, 3]
    assert f"{job(2).name} failed: RunError: agent-3 ended with code 4" in output.getvalue()


def test_a_job_that_failed_is_run_again_the_next_time(cluster: Callable[..., Client], tmp_path: Path) -> None:
    run_jobs([job(1), job(2)], Failing(), tmp_path, cluster, progress())
    assert run_jobs([job(1), job(2)], made_up, tmp_path, cluster, progress()) == {}
    assert [fact.seed for fact in read_facts(tmp_path / FACTS)] == [1, 1, 2, 2]


def test_on_a_pipe_every_finished_job_is_a_line(cluster: Callable[..., Client], tmp_path: Path) -> None:
    output = io.StringIO()
    run_jobs([job(1)], made_up, tmp_path, cluster, progress(output))
    assert "study x: 1 jobs, 0 of them collected before" in output.getvalue()
    assert f"1/1 {job(1).name}, 0 s" in output.getvalue()


def test_on_a_terminal_a_bar_tells_what_is_done_and_left(cluster: Callable[..., Client], tmp_path: Path) -> None:
    output = io.StringIO()
    terminal = Console(file=output, width=120, force_terminal=True)
    run_jobs([job(1), job(2)], made_up, tmp_path, cluster, Progress(terminal, "study x"))
    assert "2/2" in output.getvalue()
    assert "left" in output.getvalue()


def test_facts_collected_under_other_settings_are_not_taken_for_these(tmp_path: Path) -> None:
    write_facts(part_of(tmp_path, job(1, "meta.t0=42")), made_up(job(1)))
    assert collected(tmp_path, [job(1, "meta.t0=66")]) == []


def test_names_of_jobs_tell_variant_and_seed_and_are_names_of_files() -> None:
    assert job(7, variant="topology=full").name.startswith("topology-full-s007-")
    assert job(7).name.startswith("base-s007-")
    assert len({job(1).name, job(2).name, job(1, "a=1").name, job(1, variant="v").name}) == 4


def test_a_comment_in_the_scenario_makes_no_other_job() -> None:
    assert Job("", 1, "# why\n" + SCENARIO, ()).name == job(1).name


def test_a_study_with_a_failed_job_has_tables_of_the_others_and_ends_with_its_name(
    cluster: Callable[..., Client], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(jouleswarm.studies.cluster, "connected", lambda scheduler, workers: cluster())
    monkeypatch.setattr(jouleswarm.studies.deployment, "run_job", FailingDeployment())
    asked = Request(ROOT / "scenarios" / "quick.toml", (), (1, 2), 42)
    where = Where(tmp_path / "work", tmp_path / "results", 1, None, keep=False)
    # of each seed nine methods, and two with one robot a task; the second seed's fail
    with pytest.raises(StudyError, match=r"11 of 22 jobs failed, .* base-s002-\w+ \(RunError: agent-3 ended"):
        run_study(kind_of("baselines"), asked, "compact", where, Console(file=io.StringIO()))
    assert "| fl | 23.0 |" in (tmp_path / "results" / "baselines.md").read_text()  # 11 + 12 rounds


def test_jobs_run_on_a_cluster_of_the_users(client: Client, tmp_path: Path) -> None:
    address = client.scheduler.address
    assert run_jobs([job(1)], made_up, tmp_path, lambda: connected(address, 1), progress()) == {}
    assert read_facts(tmp_path / FACTS) == made_up(job(1))


def test_workers_are_processes_that_a_ctrl_c_at_the_terminal_does_not_reach() -> None:
    with connected(None, 1) as client:
        assert client.submit(os.getpid).result() != os.getpid()
        assert signal.SIGINT in client.submit(signal.pthread_sigmask, signal.SIG_BLOCK, []).result()
    assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, [])


def test_a_scheduler_that_is_not_there_is_told() -> None:
    with pytest.raises(StudyError, match=r"no Dask scheduler answered at 'nonsense://x'"), connected("nonsense://x", 1):
        pass


def test_workers_do_not_look_into_the_current_folder_and_this_process_goes_on_as_it_was(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.delenv("PYTHONSAFEPATH", raising=False)
    with connected(None, 1) as client:
        assert client.submit(os.environ.get, "PYTHONSAFEPATH").result() == "1"
    assert "PYTHONSAFEPATH" not in os.environ
