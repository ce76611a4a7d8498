"""Write a page for each task on which its expert solves it in 3D; `make docs` does so.

The pages need no network: each holds its scene and one episode, about 150 kB.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

import gymnasium as gym

import duobench
from duobench.cli.shared.console import console
from duobench.evaluation.policies import ExpertPolicy
from duobench.evaluation.rollout import Info, Observation, Step, rollout
from duobench.files import write
from duobench.looks.look import Look
from duobench.replay.playback import PoseCollector, SceneCache
from duobench.results.suite import Episode, find_tasks
from duobench.tasks import catalog
from duobench.web.page import EpisodeReplay, replay_page

FOLDER = Path(__file__).parent / "replays"
EPISODE = 0
"""Index of the episode that is shown."""


class Collector(PoseCollector):
    """Keeps poses, the instruction, and when each stage was reached."""

    def __init__(self) -> None:
        """Begin without an episode."""
        super().__init__(SceneCache(), Look())
        self.instruction = ""
        self.stage_changes: list[tuple[int, int]] = []

    def on_episode_start(self, env: gym.Env, observation: Observation, info: Info) -> None:
        """Keep what is to be done."""
        self.instruction = info["instruction"]
        super().on_episode_start(env, observation, info)

    def on_step(self, step: Step) -> None:
        """Keep a stage that was newly reached."""
        super().on_step(step)
        reached = self.stage_changes[-1][1] if self.stage_changes else 0
        if (stage := step.info["stage"]) > reached:
            self.stage_changes.append((step.number, stage))


def page(name: str) -> str:
    """The page of a task, as HTML."""
    (task,) = find_tasks([name])
    episode = Episode(task=task, index=EPISODE)
    env = duobench.make(name, cameras=False)
    collector = Collector()
    rollout(env, ExpertPolicy(env), seed=episode.seed, watchers=[collector])
    env.close()
    scene, changes = collector.geometry, tuple(collector.stage_changes)
    if scene is None or changes[-1][1] != task.max_stage:
        raise SystemExit(f"The expert did not solve {name}.")
    replay = EpisodeReplay(
        title=f"{task.title}: the scripted expert, episode {EPISODE}",
        scene=scene.name,
        track=collector.track(),
        stage_changes=changes,
        stages=task.stages,
        instruction=collector.instruction,
    )
    return replay_page(task.title, {scene.name: scene.data}, [replay])


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
