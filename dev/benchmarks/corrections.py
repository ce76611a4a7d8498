"""Measure corrections: policies that fail, and a scripted person who takes over.

`python -m dev.benchmarks.corrections --out DIR` lets `random`, and an expert that freezes, play in
two tasks; `--policies` may name others, as `module:attribute`. Kept are episodes that
the person led to success, and it goes on until there are enough of them. It prints how often the
person got there, and the policy without one, and the largest step of a commanded target where the
leader changes, beside what a joint may move in a step.
"""

import argparse
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from dev.tools.corrector import AtStep, Corrector, Fails, Sees, StandsStill, play
from dev.tools.entries import entry
from duobench.core.types import CONTROL_HZ, OPENING_SLOTS, Array
from duobench.data import Actor, ActorKind, DataSet
from duobench.data.attempts import of_task
from duobench.envs.action_modes import JOINT
from duobench.evaluation.policies import ExpertPolicy, source
from duobench.policy import Policy, PolicyMetadata
from duobench.teleop.hands import HandDevice
from duobench.teleop.policy_leader import PolicyLeader
from duobench.teleop.teleoperation import Teleoperation, make_recorder
from duobench.world.robot.joints import VELOCITY_LIMITS

TASKS = ("carry_pot", "transfer_cube")
PERSON = Actor(kind=ActorKind.SCRIPTED_OPERATOR, name="corrector", device="hands")
TIME_LIMIT_S = 75.0
"""Simulated seconds of an episode."""
LAYOUTS = range(10_000, 20_000)
"""Layouts of `train` that are led: demonstrations have those before, and networks are told apart by
those behind."""
LIMIT = np.tile(np.array(VELOCITY_LIMITS), 2) / CONTROL_HZ
"""What each joint may move in a control step (14,), in radians."""
RANDOM, FROZEN = POLICIES = ("random", "frozen")


class FrozenExpert:
    """The expert, which stops for good at a step that follows from the episode's seed."""

    def __init__(self, env: Any) -> None:
        self._expert = ExpertPolicy(env)
        self._hold = env.get_wrapper_attr("hold_action")
        self.metadata = PolicyMetadata(name=FROZEN, cameras=())
        self._steps = self._freezes = 0

    def reset(self, instruction: str, seed: int) -> None:
        """Begin an episode."""
        self._expert.reset(instruction, seed)
        self._steps = 0
        self._freezes = int(np.random.default_rng(seed).integers(20, 140))

    def act(self, observation: object) -> Array:
        """The expert's action, or none."""
        self._steps += 1
        if self._steps > self._freezes:
            return self._hold()[None]
        return self._expert.act(observation)


@dataclass(frozen=True, kw_only=True, slots=True)
class Corrected:
    """Outcome of some episodes."""

    episodes: int
    """Those that the person led to success."""
    failures: int
    """Those in which the person did not get there."""
    alone: int
    """Those in which the policy did."""
    takeovers: int
    releases: int
    share: float
    """Share of rows that the person led."""
    largest: float
    """Largest step of a joint's target where the leader changes, in steps' limits."""
    asked: float
    """The same of what the person's first action asked for; NaN where that is no joint target."""


def record(task: str, policy: str, data: DataSet, episodes: int) -> None:
    """Record corrected episodes of one task and policy, until there are so many."""
    found = source(RANDOM if policy == FROZEN else policy)
    recorder = make_recorder(
        task, data, PERSON, metadata=found.metadata, time_limit_s=TIME_LIMIT_S
    )
    made: Policy = FrozenExpert(recorder) if policy == FROZEN else found.bind(recorder)
    actor = Actor(kind=ActorKind.POLICY, name=policy, version=found.metadata.version)
    with (
        closing(found),
        closing(
            Teleoperation(
                recorder,
                HandDevice(lockstep=True),
                episodes=LAYOUTS,
                lockstep=True,
                policy=PolicyLeader(recorder, made, actor, waits=True),
            )
        ) as session,
    ):
        lets_go = policy in POLICIES
        person = Corrector(session, entry(task), _watching(policy), lets_go=lets_go)
        play(session, person, episodes)


def _watching(policy: str):
    def watch(episode: int) -> Sees:
        if policy == FROZEN:
            return StandsStill()
        if policy != RANDOM:
            return Fails()
        step = int(np.random.default_rng(episode).integers(10, 60))
        return AtStep(step, "wrong object")

    return watch


def measure(data: DataSet, task: str) -> Corrected:
    """Measure recorded corrections of a task."""
    joints = np.delete(np.arange(16), OPENING_SLOTS)
    largest = asked = 0.0
    takeovers = releases = led = rows = 0
    recordings = list(data.recordings(task))
    for each in recordings:
        is_person = np.array(
            [actor.kind is ActorKind.SCRIPTED_OPERATOR for actor in each.info.actors]
        )[each.leader]
        led += int(is_person.sum())
        rows += len(each)
        changes = 1 + np.flatnonzero(np.diff(is_person))
        sent = each.sent[:, joints]
        steps = np.abs(sent[changes] - sent[changes - 1]) / LIMIT
        begun = changes[is_person[changes]]
        wanted = np.abs(each.action[begun][:, joints] - sent[begun - 1]) / LIMIT
        if each.info.action_mode != JOINT.name:
            wanted[:] = np.nan
        largest = max(largest, steps.max(initial=0.0))
        asked = np.maximum(asked, wanted.max(initial=0.0))
        takeovers += len(begun)
        releases += len(changes) - len(begun)
        assert [one.step for one in each.info.takeovers] == begun.tolist()
        assert all(one.why for one in each.info.takeovers[:1])
    others = [one for one in of_task(data, task) if not one.kept]
    alone = sum(one.success for one in others)
    return Corrected(
        episodes=len(recordings),
        failures=len(others) - alone,
        alone=alone,
        takeovers=takeovers,
        releases=releases,
        share=led / max(rows, 1),
        largest=largest,
        asked=float(asked),
    )


def main() -> None:
    """Record and measure, and print a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--episodes", type=int, default=20)
    parser.add_argument("--tasks", nargs="+", default=TASKS)
    parser.add_argument("--policies", nargs="+", default=POLICIES)
    options = parser.parse_args()
    table = Table(
        "task",
        "policy",
        "success",
        "alone",
        "take-overs",
        "releases",
        "led",
        "largest",
        "asked",
    )
    for task in options.tasks:
        for policy in options.policies:
            data = DataSet.open(options.out / policy.replace(":", "-"))
            record(task, policy, data, options.episodes)
            found = measure(data, task)
            table.add_row(
                task,
                policy,
                f"{found.episodes} of {found.episodes + found.failures}",
                str(found.alone),
                str(found.takeovers),
                str(found.releases),
                f"{found.share:.0%}",
                f"{found.largest:.2f}",
                f"{found.asked:.2f}",
            )
    Console().print(table)


if __name__ == "__main__":
    main()
