"""Run by the environment of VLAgents: its own server of an agent, at a port, with its settings."""

import sys
import time

import numpy as np
from vlagents import register_agent
from vlagents.__main__ import start_server
from vlagents.policies.interface import Act, Agent, Obs, SingleAct


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


if __name__ == "__main__":
    port, name = sys.argv[1:]
    for agent in (Leans, OneArmed, Sleeps, Fails):
        register_agent(agent.__name__, agent)
    start_server(name, port=int(port))
