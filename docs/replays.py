"""Write a page for each task on which its expert solves it in 3D; `make docs` does so.

The pages need no network: each holds its scene and one episode, about 150 kB.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

import duobench
from duobench.cli.shared.console import console
from duobench.core.files import write
from duobench.evaluation.policies import ExpertPolicy
from duobench.evaluation.replay.trajectory import SceneCache, TrajectoryRecorder
from duobench.evaluation.rollout import rollout
from duobench.results.suite import Episode, find_tasks
from duobench.tasks import catalog
from duobench.web.page import EpisodeReplay, replay_page
from duobench.world.looks.look import Look

FOLDER = Path(__file__).parent / "tasks" / "replays"
EPISODE = 0
"""Index of the episode that is shown."""


def page(name: str) -> str:
    """The page of a task, as HTML."""
    (task,) = find_tasks([name])
    episode = Episode(task=task, index=EPISODE)
    env = duobench.make(name, cameras=False)
    recorder = TrajectoryRecorder(SceneCache(), Look())
    rollout(env, ExpertPolicy(env), seed=episode.seed, watchers=[recorder])
    env.close()
    shown = recorder.trajectory()
    if shown.stage_changes[-1][1] != task.max_stage:
        raise SystemExit(f"The expert did not solve {name}.")
    replay = EpisodeReplay(
        title=f"{task.title}: the scripted expert, episode {EPISODE}",
        scene=shown.scene,
        track=shown.track,
        stage_changes=shown.stage_changes,
        stages=task.stages,
        instruction=shown.instruction,
    )
    return replay_page(task.title, {shown.scene: shown.scene_data}, [replay])


def main(arguments: Sequence[str] | None = None) -> None:
    """Write the pages."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("tasks", nargs="*", default=catalog.names())
    parser.add_argument("--out", type=Path, default=FOLDER)
    asked = parser.parse_args(arguments)
    for name in asked.tasks:
        text = page(name).encode()
        write(asked.out / f"{name}.html", text)
        console().print(f"{name}: {len(text) / 1000:.0f} kB")


if __name__ == "__main__":
    main()
