"""One policy answers all workers, in a process of its own or behind a server; both really die."""

import re
import signal
import subprocess
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import replace
from functools import partial
from pathlib import Path

import pytest

from duobench.core.errors import MachineryError, OtherRunError, PolicyError, ServingError
from duobench.evaluation.policies import PolicyChoice
from duobench.evaluation.runners.evaluations import evaluate
from duobench.policy import Batching
from duobench.policy.serving.client import OpenpiPolicy
from duobench.policy.serving.connection import is_healthy
from duobench.policy.serving.message_format import MessageFormat
from duobench.results.folder import RunFolder
from duobench.results.run import TimeLimits
from tests.evaluation import toy_batches
from tests.evaluation.conftest import compared, small_suite
from tests.evaluation.processes import wait_until
from tests.policy.serving.serving import Serve, free_port, server_at, start_server

FIXED = Batching(size=3)
KEY = "s3cret-of-the-test"


def named(policy: type, batching: Batching | None = FIXED) -> PolicyChoice:
    return PolicyChoice(name=f"{toy_batches.__name__}:{policy.__name__}", batching=batching)


def episodes(folder: RunFolder) -> dict[str, bytes]:
    """All records, by task and index, without what the name of their policy decides."""
    records = {Path(name): c for name, c in compared(folder).items() if name.startswith("records")}
    return {
        f"{path.parts[1]}/{path.name}": re.sub(rb'\n  "(run|policy|sha256)": .*', b"", content)
        for path, content in records.items()
    }


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """Records of the policy in this process."""
    folder = RunFolder(tmp_path_factory.mktemp("undisturbed") / "run")
    evaluate(named(toy_batches.Wanders), small_suite(episodes=3), folder, workers=0)
    records = episodes(folder)
    own = rb'"(seed|policy_seed|episode|task)": .*'
    assert len({re.sub(own, b"", content) for content in records.values()}) == 6
    return records


@pytest.mark.long
@pytest.mark.parametrize(("policy", "workers"), [("Wanders", 1), ("Wanders", 4), ("DiesOnce", 2)])
def test_records_do_not_depend_on_the_workers_nor_on_a_death(play, undisturbed, policy, workers):
    choice = named(getattr(toy_batches, policy))
    folder, results = play(choice, workers=workers, episodes=3)
    assert results.overall.errors == 0
    assert episodes(folder) == undisturbed
    assert results.tasks[0].records[0].versions["inference"] == "fixed batches of 3, float32, cpu"
    assert folder.read_run().candidate.batching == FIXED


def but(records, *names):
    """Records without some."""
    return {name: content for name, content in records.items() if name not in names}


@pytest.mark.long
@pytest.mark.parametrize("workers", [1, 3])
def test_episode_in_which_the_policy_always_dies_fails_alone(play, undisturbed, workers):
    folder, results = play(named(toy_batches.DiesInOne), workers=workers, episodes=3)
    assert results.overall.errors == 1
    assert but(episodes(folder), "nod/00000.json") == but(undisturbed, "nod/00000.json")


@pytest.mark.long
@pytest.mark.parametrize("workers", [1, 3])
def test_policy_that_hangs_fails_its_episode_only(play, undisturbed, workers):
    limits = TimeLimits(act_timeout=4.0)
    folder, results = play(named(toy_batches.Hangs), workers=workers, episodes=3, limits=limits)
    assert results.overall.errors == 1
    record = results.tasks[0].records[0]
    assert record.reason.startswith("PolicyTimeoutError: The policy did not answer within 4 s")
    assert record.steps == 6
    assert but(episodes(folder), "wave/00000.json") == but(undisturbed, "wave/00000.json")


@pytest.mark.long
def test_policy_that_breaks_in_a_batch_fails_its_episodes_only(play, undisturbed):
    folder, results = play(named(toy_batches.Breaks), workers=2, episodes=3)
    reasons = {r.episode: r.reason for one in results.tasks for r in one.records if r.error}
    assert reasons[0] == "ZeroDivisionError: my policy is broken"
    assert "returned nan" in reasons[1]
    assert len(reasons) == results.overall.errors == 2
    broken = ("wave/00000.json", "wave/00001.json")
    assert but(episodes(folder), *broken) == but(undisturbed, *broken)


def test_other_batches_are_another_run(play):
    play(named(toy_batches.Wanders), episodes=1)
    with pytest.raises(OtherRunError, match=r"batches .*dynamic.* instead of .*fixed"):
        play(named(toy_batches.Wanders, Batching(mode="dynamic", size=3)), episodes=1)


@pytest.mark.parametrize("workers", [0, 1])
def test_plain_policy_has_no_batches(play, workers):
    with pytest.raises(PolicyError, match="answers one observation at a time"):
        play(PolicyChoice(name="random", batching=FIXED), episodes=1, workers=workers)


@pytest.mark.long
def test_state_of_the_objects_reaches_plain_batched_and_served_policies(play, serve: Serve):
    plain, results = play("Reads", "plain", workers=2, episodes=2)
    batched, _ = play(named(toy_batches.Reads), "batched", workers=2, episodes=2)
    server = server_at(serve(toy_batches.Reads()), execute=30)
    served, _ = play(PolicyChoice(name="openpi", server=server), "served", episodes=2)
    with pytest.raises(ServingError, match="A server of DuoBench needs no format"):
        OpenpiPolicy(replace(server, message_format=MessageFormat()))
    assert results.overall.errors == 0
    played = []
    for folder in (plain, batched, served):
        records = episodes(folder).items()
        played.append({name: re.sub(rb'\n  "versions": .*', b"", one) for name, one in records})
        candidate = folder.read_run().candidate
        assert (candidate.privileged, candidate.config.object_state) == (True, True)
    assert played == played[:1] * 3


class Serving:
    """A `duobench serve` in a process of its own, at a port that stays the same."""

    def __init__(self) -> None:
        self.port = free_port()
        self.server = server_at(self.port, key=KEY, execute=30, wait_s=2.0)
        self.choice = PolicyChoice(name="openpi", server=self.server)

    @contextmanager
    def process(self) -> Iterator[subprocess.Popen[bytes]]:
        """Serve as long as the block lasts, or until it is killed."""
        options = ("--max-batch", str(FIXED.size))
        with start_server(
            toy_batches.Wanders, self.port, *options, DUOBENCH_API_KEY=KEY
        ) as process:
            try:
                wait_until(lambda: is_healthy(self.server), "a server")
                yield process
            finally:
                process.kill()


@contextmanager
def after_a_record(folder: Path, do: Callable[[], None]) -> Iterator[Callable[[], list[Path]]]:
    """Do something once a run has a record; the block begins at once, and gets the records."""

    def found() -> list[Path]:
        return list(folder.glob("records/*/*/*.json"))

    doing = threading.Thread(target=lambda: (wait_until(found, "a record"), do()))
    doing.start()
    yield found
    doing.join()


@pytest.mark.long
def test_server_that_is_killed_and_started_again_gives_the_undisturbed_result(
    play, undisturbed, tmp_path
):
    serving, asked = Serving(), {"workers": 1, "episodes": 3}
    with ExitStack() as servers:
        first = servers.enter_context(serving.process())

        def restart() -> None:
            first.send_signal(signal.SIGKILL)
            first.wait()
            servers.enter_context(serving.process())

        with after_a_record(tmp_path / "run", restart), suppress(MachineryError):
            play(serving.choice, **asked)  # three attempts may take less than a server's start
        folder, results = play(serving.choice, **asked)
    assert results.overall.errors == 0
    assert episodes(folder) == undisturbed
    for path in folder.path.rglob("*"):
        content = b"" if path.is_dir() else path.read_bytes()
        assert KEY.encode() not in content
        assert f":{serving.port}".encode() not in content


@pytest.mark.long
@pytest.mark.parametrize("end", [signal.SIGKILL, signal.SIGSTOP])
def test_server_that_dies_or_hangs_ends_the_run_with_the_rest_unplayed(play, tmp_path, end):
    serving, limits = Serving(), TimeLimits(act_timeout=4.0)
    with (
        serving.process() as server,
        after_a_record(tmp_path / "run", partial(server.send_signal, end)) as found,
        pytest.raises(MachineryError, match="cannot be played; in each of 3 attempts"),
    ):
        play(serving.choice, workers=1, episodes=20, limits=limits)
    kept = found()
    assert 1 <= len(kept) < 40
    assert all(b'"error": null' in path.read_bytes() for path in kept)
