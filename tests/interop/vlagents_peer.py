"""Run by the environment of VLAgents: `serve PORT AGENT`, `probe PORT AGENT` and
`evaluate PORT TASK OPTIONS`.

`serve` is VLAgents' own server, with its own settings, and needs nothing of DuoBench. `evaluate`
plays the tasks of DuoBench in VLAgents' own evaluation, `probe` asks a server what nobody should;
both print one JSON object.
"""

import json
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict
from typing import Any

import json_numpy
import numpy as np
from vlagents import register_agent, register_env
from vlagents.__main__ import start_server
from vlagents.client import RemoteAgent
from vlagents.envs.interface import AgentConfig, EvalConfig
from vlagents.eval import multi_eval
from vlagents.policies.interface import Act, Agent, Obs, SingleAct, SingleObs

EPISODES = 2


class Leans(Agent):
    """Moves both arms by what it sees in one pixel and in the instruction."""

    def __init__(self) -> None:
        super().__init__("")

    def act(self, obs: Obs) -> Act:
        super().act(obs)
        pixel = obs.obs["left"].cameras["head"][100, 100, 0]
        step = np.float32(0.0001) * np.float32(pixel) + np.float32(0.001) * len(self.instruction)
        steps = np.arange(1, 9, dtype=np.float32)
        return Act(
            acts=[
                {
                    side: SingleAct(action=arm.joints + step * n, gripper=1.0)
                    for side, arm in obs.obs.items()
                }
                for n in steps
            ]
        )


class OneArmed(Leans):
    """Forgets an arm."""

    def act(self, obs: Obs) -> Act:
        return Act(acts=[{"left": act["left"]} for act in super().act(obs).acts])


class Sleeps(Leans):
    """Takes too long."""

    def act(self, obs: Obs) -> Act:
        time.sleep(3)
        return super().act(obs)


class Fails(Leans):
    """Leaves the process, or tries to."""

    def act(self, obs: Obs) -> Act:
        sys.exit(f"will not {obs.language_instruction}")


def wait_for(port: int, name: str) -> RemoteAgent:
    """Connect to a server once it has its agent."""
    while True:
        with suppress(OSError):
            agent = RemoteAgent("localhost", port, name)
            break
        time.sleep(0.2)
    while not agent.is_initialized():
        time.sleep(0.2)
    return agent


def probe(port: int, name: str) -> None:
    agent = wait_for(port, name)
    assert agent.c is not None
    root = agent.c.root
    arms = {side: SingleObs(joints=np.zeros(7), gripper=0.0) for side in ("left", "right")}

    def ask(**info: Any) -> Any:
        arms["left"].info = info
        obs = Obs(obs=arms, language_instruction="Do it.")
        return json.loads(root.act(json_numpy.dumps(asdict(obs))))

    def error_of(call: Callable[[], object]) -> str:
        try:
            call()
        except Exception as error:  # noqa: BLE001 - whichever it is
            return f"{type(error).__name__}: {error}"
        return ""

    asked = [(1, 0), (1, 1), (1, 1), (2, 0), (1, 0)]
    answers = [ask(policy_seed=seed, episode_step=step) for seed, step in asked]
    errors = [
        error_of(lambda: ask(policy_seed=2, episode_step=1)),
        error_of(lambda: ask(episode_step=0, action_mode="cartesian")),
        error_of(lambda: root.agent),
    ]
    told = {"answers": answers, "errors": errors, "git": agent.git_status()}
    json.dump(told, sys.stdout)


def evaluate(port: int, task: str, options: dict[str, Any]) -> None:
    from duobench.interop.vlagents import register
    from duobench.interop.vlagents.environment import TaskEnv

    ends: list[str] = []
    infos: list[dict[str, Any]] = []

    class Watched(TaskEnv):
        """Notes what an agent is told at the start of every episode, and what that ends in."""

        def reset(self, seed: int | None = None, options: Any = None) -> Any:
            obs, info = super().reset(seed, options)
            if seed is not None:  # they also reset after an episode
                infos.append(dict(obs.obs["left"].info))
            return obs, info

        def chunk_step(self, actions: Any, max_steps: int | None = None) -> Any:
            result = super().chunk_step(actions, max_steps)
            if result[2] or result[3]:
                ends.append(self.env.get_wrapper_attr("state_hash")())
            return result

    register()
    register_env(f"duobench/{task}", Watched)
    config = EvalConfig(f"duobench/{task}", options, max_steps_per_episode=10_000, seed=0)
    wait_for(port, "duobench").close()
    agent = AgentConfig("localhost", "duobench", {}, port=port)
    results, _ = multi_eval(agent, [config], EPISODES)
    json.dump({"results": results[0].tolist(), "ends": ends, "infos": infos}, sys.stdout)


if __name__ == "__main__":
    verb, where, name, *rest = sys.argv[1:]
    if verb == "serve":
        for agent in (Leans, OneArmed, Sleeps, Fails):
            register_agent(agent.__name__, agent)
        start_server(name, port=int(where))
    elif verb == "probe":
        probe(int(where), name)
    else:
        evaluate(int(where), name, json.loads(rest[0]))
