"""`duobench eval`: a policy, played on tasks."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import tyro

from duobench.cli.shared.advice import advising, for_evaluation, relative
from duobench.cli.shared.console import counted, results_table, say
from duobench.cli.shared.options import command_line
from duobench.cli.shared.process import load_engine, raising
from duobench.cli.shared.progress import EpisodesPlayed, display
from duobench.core.errors import EvaluationError, PolicyError
from duobench.envs.execution import ChunkExecution
from duobench.evaluation.runners.ray_process import Cluster
from duobench.policy.batch import MAX_BATCH, Batching
from duobench.policy.serving.access import read_key
from duobench.policy.serving.address import SERVED, RemoteServer
from duobench.policy.serving.message_format import read_format
from duobench.results.folder import RunFolder
from duobench.results.run import (
    WHOLE,
    Resuming,
    Shard,
    TimeLimits,
)
from duobench.results.scores import Results
from duobench.results.suite import PAPER_EXECUTE, SuiteChoice

if TYPE_CHECKING:
    from duobench.evaluation.policies import PolicyChoice


_LIMITS = TimeLimits()
_RESUMING = Resuming()
_SUITE = SuiteChoice()
_EXECUTION = ChunkExecution()
_CLUSTER = Cluster()


@dataclass(frozen=True, kw_only=True, slots=True)
class PolicyOptions:
    """Which policy plays."""

    policy: str
    """expert (also expert:human or expert:wide, which vary what it does), blind, hold, random,
    zero, lerobot:PATH_OR_ID for a checkpoint of LeRobot, module:attribute for a policy of your own,
    or openpi or vla-eval for one that is served, whichever it speaks."""
    batch: Literal["fixed", "dynamic"] | None = None
    """For a policy of your own that answers many episodes at a time: fixed fills every batch up;
    dynamic takes what waits, which is faster."""
    max_batch: int | None = None
    """Observations that such a policy answers together, at most. Default: 8."""
    server: str | None = None
    """Address of a policy that is served, such as ws://127.0.0.1:8000."""
    format: str | None = None
    """Message format of a server that is not of DuoBench: aloha, droid, libero, vla_eval, or
    FILE.toml."""
    wait: float = 60.0
    """Seconds to wait for a server that is not there."""
    key_file: Path | None = None
    """File with the key for the server, in place of DUOBENCH_API_KEY."""

    def choose(self, execute: int) -> PolicyChoice:
        """The policy, of whose chunks so many actions are executed if it is served."""
        from duobench.evaluation.policies import PolicyChoice

        batching = None
        if self.batch is not None or self.max_batch is not None:
            size = MAX_BATCH if self.max_batch is None else self.max_batch
            batching = Batching(mode=self.batch or "fixed", size=size)
        if (self.policy in SERVED) != (self.server is not None):
            names = " or ".join(SERVED)
            raise PolicyError(f"--policy {names} and --server URL go together.")
        if self.server is None:
            if self.format is not None:
                raise PolicyError("--format is for a policy at a --server.")
            return PolicyChoice(name=self.policy, batching=batching)
        server = RemoteServer(
            url=self.server,
            key=read_key(self.key_file),
            message_format=None if self.format is None else read_format(self.format),
            execute=execute,
            wait_s=self.wait,
        )
        return PolicyChoice(name=self.policy, batching=batching, server=server)


def run(  # noqa: PLR0913, PLR0917 - each is an argument of the command line
    policy: tyro.conf.OmitArgPrefixes[PolicyOptions],
    out: Path,
    suite: tyro.conf.OmitArgPrefixes[SuiteChoice] = _SUITE,
    execution: tyro.conf.OmitArgPrefixes[ChunkExecution] = _EXECUTION,
    limits: tyro.conf.OmitArgPrefixes[TimeLimits] = _LIMITS,
    workers: int = 1,
    shard: str | None = None,
    executor: Literal["processes", "ray"] = "processes",
    cluster: tyro.conf.OmitArgPrefixes[Cluster] = _CLUSTER,
    videos: int | None = None,
    video_look: str | None = None,
    observer: tyro.conf.UseAppendAction[tuple[str, ...]] = (),
    resuming: tyro.conf.OmitArgPrefixes[Resuming] = _RESUMING,
) -> None:
    """Roll a policy out on tasks, and leave records, a table and a report.

    The same command in the same folder goes on where it was stopped, also with more episodes. The
    exit code is 1 if an episode failed with an error.

    Args:
        policy: Which policy plays, and how it is reached.
        out: Folder of the run.
        suite: What is played; other options change what the name of a suite stands for.
        execution: What is executed of the policy's chunks. Without a number what the suite says;
            without a suite all, and 30 of a served policy.
        limits: How long the policy may take.
        workers: Simulators that play side by side, in processes of their own; the policy has
            another one. With 0 this process does everything, for a debugger: the policy can see the
            simulator, hang, and end the run.
        shard: Play a part of the run alone, such as 3/16 for the third of sixteen, counted from 1.
            All parts go into one --out, or into several whose contents are copied into one
            afterwards; see the page scale.
        executor: ray plays on a Ray cluster that is there (extra ray; see the page scale):
            --workers simulators on its nodes, policies in actors; this process alone writes.
        cluster: The Ray cluster.
        videos: How many episodes of each task have a video: 1, and 0 under each shift of the suite
            robust, unless another number is given.
        video_look: Look of the table in videos, such as studio; without one, that of --look.
        observer: module:NAME of an observer, or of a class or function that makes one; it is told
            of every finished episode, such as to log it. Give it once for each.
        resuming: What is done with a run that is there.
    """
    command = command_line("eval", run, locals())
    load_engine()
    from duobench.evaluation.observers import load_observer
    from duobench.evaluation.runners.evaluations import evaluate as play

    if executor != "ray" and cluster != _CLUSTER:
        raise EvaluationError("--address and --policy-gpus are for --executor ray.")
    played = suite.make(execution)
    choice = policy.choose(played.execution.execute or PAPER_EXECUTE)
    observers = [load_observer(path) for path in observer]
    part = WHOLE if shard is None else Shard.parse(shard)
    if workers == 0 and not choice.kind.is_scripted and choice.server is None:
        say(
            "The policy plays in the process of the simulator, which it can see and move."
        )
    if choice.server is not None and choice.server.wait_s:
        say(
            f"Connecting to the policy's server; waiting up to {choice.server.wait_s:g} s for it."
        )
    folder = RunFolder(out)
    with (
        advising(for_evaluation(folder, policy.policy)),
        raising(out),
        display("episode") as shown,
    ):
        results = play(
            choice,
            played,
            folder,
            videos=int(len(played.shifts) == 1) if videos is None else videos,
            video_look=video_look,
            limits=limits,
            workers=workers,
            observers=[EpisodesPlayed(shown, part), *observers],
            resuming=resuming,
            command=command,
            shard=part,
            cluster=cluster if executor == "ray" else None,
        )
    _show(folder, part, results)


def _show(
    folder: RunFolder,
    shard: Shard,
    results: Results,
) -> None:
    """Print the results; the exit code is 1 if an episode failed with an error."""
    from duobench.results.report import read_parts

    parts = read_parts(folder)
    run, overall = parts[0].run, results.overall
    if shard.is_whole and len(parts) == 1:
        say(results_table(parts[0]))
    elif said := dict.fromkeys(
        part.repeatability for part in parts if part.repeatability
    ):
        say("\n".join(said))
    if (
        shard.is_whole
        or sum(part.results.overall.episodes for part in parts) == run.size
    ):
        say(f"Report: {relative(folder.page)}")
    else:
        whole = f"duobench report {relative(folder.path)}"
        say(f"Shard {shard} is finished; {whole} shows all together.")
    if overall.errors:
        changed = "a policy that was changed needs another --out, or --fresh"
        if overall.errors == overall.episodes:
            changed = (
                "without it they are played again too, once the policy was changed"
            )
        say(
            f"{counted(overall.errors, 'episode')} failed with an error; the report has "
            "the tracebacks. To play them again, give the same command with --retry-broken; "
            f"{changed}.",
        )
        sys.exit(1)
