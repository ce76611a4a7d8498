"""Verbs that play episodes: `duobench eval`, `salt`, `record` and `replay`."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import tyro
from rich.table import Table
from tyro.conf import Positional

from duobench.cli.shared.advice import (
    FOR_RECORDING,
    FOREIGN,
    advising,
    for_evaluation,
    relative,
)
from duobench.cli.shared.console import counted, results_table, say
from duobench.cli.shared.options import command_line
from duobench.cli.shared.page import followed
from duobench.cli.shared.process import load_engine, raising
from duobench.cli.shared.progress import EpisodesKept, EpisodesPlayed, display
from duobench.cli.verbs.data import opened
from duobench.core.backend import Image
from duobench.core.errors import DataError, EvaluationError, PolicyError
from duobench.core.files import check_outside, remove_abandoned, replacing, taken_back
from duobench.envs.execution import ChunkExecution
from duobench.evaluation.runners.ray_process import Cluster
from duobench.policy.batch import MAX_BATCH, Batching
from duobench.policy.serving.access import read_key
from duobench.policy.serving.address import SERVED, RemoteServer
from duobench.policy.serving.message_format import read_format
from duobench.results.folder import VIDEO_SUFFIX, RunFolder
from duobench.results.run import WHOLE, Shard, TimeLimits
from duobench.results.salt import make_salt, read_salt
from duobench.results.scores import Results
from duobench.results.suite import PAPER_EXECUTE, SuiteChoice, find_tasks
from duobench.tasks import catalog

if TYPE_CHECKING:
    from duobench.data import DataSet, ImageSource, Recording
    from duobench.evaluation.runners.evaluate import Attempt

_LIMITS = TimeLimits()


def record(  # noqa: PLR0913, PLR0917 - each is an argument of the command line
    out: Path,
    policy: str = "expert",
    variety: Literal["none", "human", "wide"] = "human",
    tasks: tuple[str, ...] = (),
    episodes: int = 50,
    workers: int = 1,
    split: Literal["train", "eval"] = "train",
    instructions: Literal["fixed", "varied"] = "fixed",
    keep_failures: bool = False,
    after_success: float = 1.0,
    limits: tyro.conf.OmitArgPrefixes[TimeLimits] = _LIMITS,
) -> None:
    """Record demonstrations: states and actions; images are rendered from them later.

    Every task gets that many successful episodes; those that fail are counted and left out. The
    same command in the same folder goes on where it was stopped, also with more episodes.

    Args:
        out: Folder of the data set.
        policy: expert, hold, random, zero, or module:attribute for a policy of your own.
        variety: How much the scripted experts vary their speed, ways and grasps, and are disturbed;
            only they know how to.
        tasks: Task ids (see: duobench list) or module:ATTRIBUTE; all tasks if none is named.
        episodes: Episodes of each task.
        workers: Processes that play side by side.
        split: Layouts to begin with. Those of eval are the ones that policies are evaluated on:
            whatever learns from them cannot be evaluated any more.
        instructions: What the policy is told and the data set says: the task's own instruction, or
            in each episode one that is sampled from it and ten paraphrases.
        keep_failures: Keep every episode, whether it succeeds or not.
        after_success: Seconds that a recording goes on after success, while the hands open and
            retreat; 0 ends it there.
        limits: How long the policy may take.
    """
    command = command_line("record", record, locals())
    load_engine()
    from duobench.data import DataSet
    from duobench.data.attempts import RUN
    from duobench.data.dataset import DESCRIPTION
    from duobench.evaluation.runners import record as record_demonstrations

    name = f"expert:{variety}" if policy == "expert" and variety != "none" else policy
    beginnings = DESCRIPTION, RUN
    with (
        raising(out),
        taken_back(out, *beginnings),
        advising(FOR_RECORDING),
        display("episode") as shown,
    ):
        attempts = record_demonstrations(
            name,
            find_tasks(tasks),
            DataSet.open(out, how=f"duobench record --policy {name}"),
            episodes=episodes,
            split=split,
            instructions=instructions,
            keep_failures=keep_failures,
            after_success=after_success,
            limits=limits,
            workers=workers,
            observers=[EpisodesKept(shown)],
            command=command,
        )
    say(_kept_and_failed(attempts))


def _kept_and_failed(attempts: Sequence[Attempt]) -> str:
    kept = [attempt for attempt in attempts if attempt.kept]
    steps = sum(attempt.steps for attempt in kept if attempt.success)
    failed = [attempt for attempt in attempts if not attempt.success]
    more = sum(not attempt.kept for attempt in failed)
    lines = [
        f"{counted(len(kept), 'episode')}, {steps} steps until success, after which frames are "
        f"still recorded (--after-success); {more} more did not succeed."
    ]
    unsolved = len(failed) - more
    if unsolved:
        lines.append(f"{unsolved} of the episodes did not succeed.")
    lines += [
        f"{attempt.task}, episode {attempt.episode} ended at stage {attempt.stage}"
        + (f": {attempt.error}" if attempt.error else ".")
        for attempt in failed
    ]
    return "\n".join(lines)


def replay(
    data: Positional[Path],
    mode: Literal["states", "actions"] = "states",
    tasks: tuple[str, ...] = (),
    out: Path = Path("replay"),
    cameras: tuple[str, ...] = ("overview",),
    size: tuple[int, int] = (480, 640),
    look: str = "default",
    import_tasks: bool = False,
) -> None:
    """Replay recorded episodes.

    With states, every recorded state is shown as it was, in a video for each episode, from any
    camera, at any size, in any look. With actions, the commands run through the physics again, and
    a table says whether states and stages come out the same; the exit code is 1 if they do not.

    Args:
        data: Folder of the data set.
        mode: What is replayed.
        tasks: Only these tasks; all of the data set if none is named.
        out: Folder of the videos.
        cameras: What the videos show, side by side: overview, head, left_wrist, right_wrist.
        size: Height and width of one image in pixels, both even.
        look: Look of the images: wood_table, dark, random:7, ... (see duobench docs looks).
        import_tasks: Import tasks that are not of the benchmark, which runs the code of the modules
            that the data set names.
    """
    dataset = opened(data, tasks, import_tasks=import_tasks)
    from duobench.data import Recording

    episodes: dict[str, list[Path]] = {}
    with advising(FOREIGN):
        for name in [catalog.id_of(task) for task in tasks] or dataset.tasks:
            paths = dataset.episodes_of([name])
            episodes[dataset.reference(Recording.read_info(paths[0]))] = paths
    if not episodes:
        raise DataError(f"{data} has no finished episode.")
    if mode == "actions":
        _by_actions(dataset, episodes)
    else:
        check_outside(out, dataset.path)
        with taken_back(out):
            _by_states(episodes, out, cameras, size, look)


def _by_actions(data: DataSet, episodes: Mapping[str, Sequence[Path]]) -> None:
    from duobench.data import Recording
    from duobench.evaluation.replay import replay as play_again

    table = Table("task", "episodes", "bit-exact", "same stages", "largest difference")
    wrong = 0
    for task, paths in episodes.items():
        results = []
        for path, result in zip(paths, play_again(task, map(Recording.read, paths)), strict=True):
            results.append(result)
            if not result.is_exact:
                say(
                    f"{path.relative_to(data.path)}: first differs at step {result.first}, stage "
                    f"{result.stage} instead of {result.recorded_stage}",
                )
        wrong += sum(not result.is_exact for result in results)
        table.add_row(
            task,
            str(len(results)),
            str(sum(result.is_exact for result in results)),
            str(sum(result.same_stages for result in results)),
            f"{max((result.largest for result in results), default=0.0):.2g}",
        )
    say(table)
    if wrong:
        say(
            f"{counted(wrong, 'episode')} came out differently: by other versions of MuJoCo or "
            "DuoBench than those that recorded, by a task of one's own that has changed, or on a "
            "processor that is no x86-64 with AVX2.",
        )
        sys.exit(1)


def _by_states(
    episodes: Mapping[str, Sequence[Path]],
    out: Path,
    cameras: tuple[str, ...],
    size: tuple[int, int],
    look: str,
) -> None:
    from duobench.core.video import VP9, write_video
    from duobench.data import ImageSource, Recording
    from duobench.evaluation.video import FRAME_RATE

    if not cameras:
        raise DataError("A video shows at least one camera; --cameras names none.")
    if any(side % 2 for side in size):
        raise DataError(f"Height and width of a video are even; --size is {size[0]} {size[1]}.")
    remove_abandoned(out, VIDEO_SUFFIX)
    for task, paths in episodes.items():
        with closing(ImageSource(task, cameras=cameras, size=size, look=look)) as source:
            for path in paths:
                recording = Recording.read(path)
                target = out / path.parent.name / f"{path.stem}{VIDEO_SUFFIX}"
                with replacing(target) as temporary:
                    write_video(_frames(source, recording), temporary, VP9, FRAME_RATE)
                say(str(target))


def _frames(source: ImageSource, recording: Recording) -> Iterator[Image]:
    """The images of all cameras side by side, for a video."""
    import numpy as np

    from duobench.evaluation.video import FRAME_EVERY

    for row in range(0, len(recording) + 1, FRAME_EVERY):
        yield np.concatenate(list(source.images(recording, row).values()), axis=1)


if TYPE_CHECKING:
    from duobench.evaluation.policies import PolicyChoice

_SUITE, _EXECUTION, _CLUSTER = SuiteChoice(), ChunkExecution(), Cluster()


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
            *others, last = SERVED
            names = self.policy if self.policy in SERVED else f"{', '.join(others)} or {last}"
            raise PolicyError(f"--policy {names} and --server URL go together.")
        if self.server is None:
            if self.format is not None:
                raise PolicyError("--format is for a policy at a --server.")
            return PolicyChoice.parse(self.policy, batching=batching)
        server = RemoteServer(
            url=self.server,
            key=read_key(self.key_file),
            message_format=None if self.format is None else read_format(self.format),
            execute=execute,
            wait_s=self.wait,
        )
        return PolicyChoice.parse(self.policy, batching=batching, server=server)


def evaluate(  # noqa: PLR0913, PLR0917 - each is an argument of the command line
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
    retry_broken: bool = False,
    fresh: bool = False,
    unplayed_count_as_failures: bool = False,
    watch: bool = False,
    watch_port: int = 0,
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
            afterwards; see duobench docs scale.
        executor: ray plays on a Ray cluster that is there (extra ray; see duobench docs scale):
            --workers simulators on its nodes, policies in actors; this process alone writes.
        cluster: The Ray cluster.
        videos: How many episodes of each task have a video: 1, and 0 under each shift of the suite
            robust, unless another number is given.
        retry_broken: Play the episodes again that failed with an error in an earlier call.
        fresh: Remove the run that is in the folder, whatever it was, and begin anew. A run of
            which every finished episode failed with an error gives way to a changed policy too.
        unplayed_count_as_failures: Count episodes in which a process dies each of three times as
            failures; without this they stay unplayed, and the exit code is 1.
        watch: Follow the run on a page in the browser, as duobench view --follow does.
        watch_port: Port of that page; 0 takes a free one.
    """
    command = command_line("eval", evaluate, locals())
    load_engine()
    from duobench.evaluation.runners.evaluate import evaluate as play

    if executor != "ray" and cluster != _CLUSTER:
        raise EvaluationError("--address and --policy-gpus are for --executor ray.")
    played = suite.make(execution)
    choice = policy.choose(played.execution.execute or PAPER_EXECUTE)
    part = WHOLE if shard is None else Shard.parse(shard)
    if workers == 0 and not choice.is_scripted and choice.server is None:
        say("The policy plays in the process of the simulator, which it can see and move.")
    secret = None if suite.salt is None else read_salt(suite.salt)
    if choice.server is not None and choice.server.wait_s:
        say(f"Connecting to the policy's server; waiting up to {choice.server.wait_s:g} s for it.")
    folder = RunFolder(out)
    watched = followed(folder, watch_port) if watch else nullcontext()
    with (
        advising(for_evaluation(folder, policy.policy)),
        watched,
        raising(out),
        display("episode") as shown,
    ):
        results = play(
            choice,
            played,
            folder,
            videos=int(len(played.shifts) == 1) if videos is None else videos,
            limits=limits,
            workers=workers,
            observers=[EpisodesPlayed(shown, part)],
            retry_broken=retry_broken,
            fresh=fresh,
            unplayed_count_as_failures=unplayed_count_as_failures,
            command=command,
            shard=part,
            cluster=cluster if executor == "ray" else None,
            salt=secret,
        )
    _show(folder, part, results)


def _show(folder: RunFolder, shard: Shard, results: Results) -> None:
    """Print the results; the exit code is 1 if an episode failed with an error."""
    from duobench.results.report import read_parts

    parts = read_parts(folder)
    run, overall = parts[0].run, results.overall
    if shard.is_whole and len(parts) == 1:
        say(results_table(parts[0]))
    elif said := dict.fromkeys(part.repeatability for part in parts if part.repeatability):
        say("\n".join(said))
    if shard.is_whole or sum(part.results.overall.episodes for part in parts) == run.size:
        say(f"Report: {relative(folder.page)}")
    else:
        whole = f"duobench report {relative(folder.path)}"
        say(f"Shard {shard} is finished; {whole} shows all together.")
    if overall.errors:
        changed = "a policy that was changed needs another --out, or --fresh"
        if overall.errors == overall.episodes:
            changed = "without it they are played again too, once the policy was changed"
        say(
            f"{counted(overall.errors, 'episode')} failed with an error; the report has "
            "the tracebacks. To play them again, give the same command with --retry-broken; "
            f"{changed}.",
        )
        sys.exit(1)


def salt(file: tyro.conf.Positional[Path]) -> None:
    """Make a salt: a secret from which duobench eval --salt takes seeds that nobody knows before.

    Args:
        file: The file, which its owner alone may read. One that holds a salt stays as it is.
    """
    word = "new" if make_salt(file) else "there before and not changed"
    say(f"SHA-256 of the salt in {file}, {word}: {read_salt(file).sha256}")
    say("Publish it before you play the first policy, and the file after the last: page hosting")
