"""`duobench eval`: roll a policy out and report how it did."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from duobench.cli.shared.console import console, counted
from duobench.cli.shared.engine import load_engine
from duobench.cli.shared.interrupt import raising
from duobench.cli.shared.options import command_line
from duobench.errors import EvaluationError, OptionError, PolicyError

if TYPE_CHECKING:
    from rich.console import Console

    from duobench.policy.batch import Batching
    from duobench.policy.serving.address import RemoteServer
    from duobench.results.folder import RunFolder
    from duobench.results.scores import Results
    from duobench.results.shard import Shard
    from duobench.runners.ray_cluster import Cluster
    from duobench.shifts.shift import Shift


def evaluate(  # noqa: PLR0913, PLR0917 - each is an argument of the command line
    policy: str,
    out: Path,
    tasks: tuple[str, ...] = (),
    suite: str | None = None,
    episodes: int | None = None,
    first_episode: int = 0,
    workers: int = 1,
    videos: int | None = None,
    look: str = "default",
    act_timeout: float = 120.0,
    episode_timeout: float = 1800.0,
    retry_broken: bool = False,
    fresh: bool = False,
    unplayed_count_as_failures: bool = False,
    batch: Literal["fixed", "dynamic"] | None = None,
    max_batch: int | None = None,
    server: str | None = None,
    format: str | None = None,
    execute: int | None = None,
    latency: int = 0,
    overtime: float = 1.0,
    shard: str | None = None,
    shift: str = "none",
    axes: tuple[str, ...] = (),
    levels: tuple[int, ...] = (),
    wait: float = 60.0,
    key_file: Path | None = None,
    layout: str | None = None,
    executor: Literal["processes", "ray"] = "processes",
    address: str = "auto",
    policy_gpus: float = 0.0,
) -> None:
    """Roll a policy out on tasks, and leave records, a table and a report.

    The same command in the same folder goes on where it was stopped, also with more episodes. The
    exit code is 1 if an episode failed with an error.

    Args:
        policy: expert (also expert:human or expert:wide, which vary what it does), blind, hold,
            random, zero, lerobot:PATH_OR_ID for a checkpoint of LeRobot, module:attribute for a
            policy of your own, or openpi or vla-eval for one that is served, whichever it speaks.
        out: Folder of the run.
        tasks: Task ids (see: duobench list) or module:ATTRIBUTE; all tasks if none is named.
        suite: paper (100 episodes of each task, 30 actions executed of a chunk), quick (10
            episodes), robust (20 episodes under each of 41 shifts, see docs/robustness.md), or none
            for one of your own; other options change what a name stands for.
        episodes: Episodes of each task. Default: 20, or what the suite says.
        first_episode: Index of the first episode; seeds follow from task and index alone.
        workers: Simulators that play side by side, in processes of their own; the policy has
            another one. The results do not depend on it. With 0 this process does everything, for a
            debugger: the policy can see the simulator, hang, and end the run.
        videos: How many episodes of each task have a video: 1, and 0 under each shift of the suite
            robust, unless another number is given.
        look: Look of the images that the policy sees: wood_table, dark, random:7, ... (see
            docs/looks.md).
        act_timeout: Seconds that the policy may take for one reset or one chunk of actions.
        episode_timeout: Seconds that an episode may take.
        retry_broken: Play the episodes again that failed with an error in an earlier call.
        fresh: Remove the run that is in the folder, whatever it was, and begin anew. A run of
            which every finished episode failed with an error gives way to a changed policy too.
        unplayed_count_as_failures: Count episodes in which a process dies each of three times as
            failures; without this they stay unplayed, and the exit code is 1.
        batch: For a policy of your own that answers many episodes at a time: fixed fills every
            batch up, so that results do not depend on the workers; dynamic takes what waits, which
            is faster. Default: fixed.
        max_batch: Observations that such a policy answers together, at most. Default: 8.
        server: Address of a policy that is served, such as ws://127.0.0.1:8000.
        format: Message format of a server that is not of DuoBench: aloha, droid, libero, vla_eval,
            or FILE.toml.
        execute: Actions of a chunk that are executed before the policy is asked again, at most.
            Default: what the suite says; without one all, and 30 of a served policy.
        latency: Control steps (1/30 s) from an observation to the first action of the chunk that
            answers it; until then the chunk before goes on.
        overtime: Play an episode without success on after its horizon, until it has had so many
            horizons in all, such as 1.5; the report has a column of what succeeds then. Scores and
            records end at the horizon.
        shard: Play a part of the run alone, such as 3/16 for the third of sixteen, counted from 1.
            All parts go into one --out, or into several whose contents are copied into one
            afterwards. See docs/scale.md.
        shift: Play under one shift, such as look-3; see docs/robustness.md.
        axes: Of the suite robust, these axes alone: look, camera, layout, physics, instruction,
            sensing, latency, all.
        levels: Of the suite robust, these levels alone, 1 to 5; no shift is always played.
        wait: Seconds to wait for a server that is not there.
        key_file: File with the key for the server, in place of DUOBENCH_API_KEY.
        layout: Renamed: give --format.
        executor: ray plays on a Ray cluster that is there (extra ray, docs/scale.md): --workers
            simulators on its nodes, the policy in actors, and this process, which alone writes.
        address: Address of that cluster, HOST:PORT; auto is the one of this machine.
        policy_gpus: Graphics cards that each actor of the policy asks for there.
    """
    command = command_line("eval", evaluate, locals())
    load_engine()
    from duobench.cli.shared.advice import advising, for_evaluation
    from duobench.cli.shared.progress import EpisodesPlayed, display
    from duobench.evaluation.policies import PolicyChoice
    from duobench.results.folder import RunFolder
    from duobench.results.limits import TimeLimits
    from duobench.results.shard import WHOLE, Shard
    from duobench.results.suites import PAPER_EXECUTE, make_suite
    from duobench.runners.evaluate import evaluate as play

    batching = _batching(batch, max_batch)
    _check_old_names(policy, layout)
    played = make_suite(
        suite,
        tasks=tasks,
        episodes=episodes,
        first_episode=first_episode,
        look=look,
        execute=execute,
        latency=latency,
        overtime=overtime,
        shifts=_shifts(suite, shift, axes, levels),
    )
    asked = played.execution.execute or PAPER_EXECUTE
    remote = _remote(policy, server, format, asked, wait, key_file)
    choice = PolicyChoice.parse(policy, batching=batching, server=remote)
    limits = TimeLimits(act_timeout=act_timeout, episode_timeout=episode_timeout)
    part = WHOLE if shard is None else Shard.parse(shard)
    screen = console()
    if workers == 0 and not choice.is_scripted:
        screen.print("The policy plays in the process of the simulator, which it can see and move.")
    folder = RunFolder(out)
    advised = advising(partial(for_evaluation, folder, policy))
    with (
        advised,
        raising(screen),
        display(screen, "episode") as shown,
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
            cluster=_cluster(executor, address, policy_gpus),
        )
    _show(folder, part, results, screen)


def _cluster(executor: Literal["processes", "ray"], address: str, gpus: float) -> Cluster | None:
    from duobench.runners.ray_cluster import Cluster

    if executor == "ray":
        return Cluster(address=address, policy_gpus=gpus)
    if address != Cluster().address or gpus:
        raise EvaluationError("--address and --policy-gpus are for --executor ray.")
    return None


def _shifts(
    suite: str | None, shift: str, axes: Sequence[str], levels: Sequence[int]
) -> list[Shift]:
    """The shifts that options choose; none where the suite decides."""
    from duobench.errors import check_known
    from duobench.results.suites import SUITES
    from duobench.shifts.shift import AXES, NO_AXIS, Shift

    chosen = Shift.parse(shift)
    shifts = SUITES[suite].shifts if suite is not None and suite in SUITES else ()
    if len(shifts) < 2:  # noqa: PLR2004 - the usual episodes alone
        if axes or levels:
            raise OptionError("--axes and --levels go with --suite robust; see --shift.")
        return [chosen]
    for axis in axes:
        check_known("axis of a shift", axis, AXES)
    for level in levels:
        Shift(axis=AXES[0], level=level)
    if chosen.axis != NO_AXIS:
        raise OptionError("--suite robust has shifts of its own; --shift is for other suites.")
    return [
        each
        for each in shifts
        if each.axis == NO_AXIS
        or ((not axes or each.axis in axes) and (not levels or each.level in levels))
    ]


def _show(folder: RunFolder, shard: Shard, results: Results, screen: Console) -> None:
    """Print the results; the exit code is 1 if an episode failed with an error."""
    from duobench.cli.shared.advice import relative
    from duobench.cli.shared.table import results_table
    from duobench.results.report import read_parts

    parts = read_parts(folder)
    run, overall = parts[0].run, results.overall
    if shard.is_whole and len(parts) == 1:
        screen.print(results_table(parts[0]))
    if shard.is_whole or sum(part.results.overall.episodes for part in parts) == run.size:
        screen.print(f"Report: {relative(folder.page)}")
    else:
        whole = f"duobench report {relative(folder.path)}"
        screen.print(f"Shard {shard} is finished; {whole} shows all together.")
    if overall.errors:
        changed = "a policy that was changed needs another --out, or --fresh"
        if overall.errors == overall.episodes:
            changed = "without it they are played again too, once the policy was changed"
        screen.print(
            f"{counted(overall.errors, 'episode')} failed with an error; the report has "
            "the tracebacks. To play them again, give the same command with --retry-broken; "
            f"{changed}.",
        )
        sys.exit(1)


def _batching(mode: Literal["fixed", "dynamic"] | None, size: int | None) -> Batching | None:
    from duobench.policy.batch import MAX_BATCH, Batching

    if mode is None and size is None:
        return None
    return Batching(mode=mode or "fixed", size=MAX_BATCH if size is None else size)


def _check_old_names(policy: str, layout: str | None) -> None:
    """Say what is given today where an old command was given."""
    if layout is not None:
        raise PolicyError(
            f"--layout is called --format now: --format {layout}. A layout is where objects start."
        )
    if policy.partition(":")[0] == "vlagents":
        raise PolicyError(
            "An agent of VLAgents takes two commands now. Where VLAgents is installed: "
            "DUOBENCH_VLAGENTS_AGENT=AGENT@HOST:PORT duobench serve --policy "
            "duobench.interop.vlagents:served_agent. Here: duobench eval --policy openpi "
            "--server ws://127.0.0.1:8000 --workers 1. See docs/serving.md."
        )


def _remote(
    policy: str,
    server: str | None,
    message_format: str | None,
    execute: int,
    wait: float,
    key_file: Path | None,
) -> RemoteServer | None:
    from duobench.policy.serving.access import read_key
    from duobench.policy.serving.address import SERVED, RemoteServer
    from duobench.policy.serving.message_format import read_format

    if (policy in SERVED) != (server is not None):
        *others, last = SERVED
        names = policy if policy in SERVED else f"{', '.join(others)} or {last}"
        raise PolicyError(f"--policy {names} and --server URL go together.")
    if server is None:
        if message_format is not None:
            raise PolicyError("--format is for a policy at a --server.")
        return None
    return RemoteServer(
        url=server,
        key=read_key(key_file),
        message_format=None if message_format is None else read_format(message_format),
        execute=execute,
        wait_s=wait,
    )
