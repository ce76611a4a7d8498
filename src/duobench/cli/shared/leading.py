"""A person who leads both arms from a page, in simulation or on a rig."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from duobench.cli.shared.advice import AdvisedError
from duobench.cli.shared.console import say
from duobench.cli.shared.process import stopping

if TYPE_CHECKING:
    import gymnasium as gym

    from duobench.data import Actor
    from duobench.evaluation.policies import PolicySource
    from duobench.teleop.intent import TeleopDevice
    from duobench.teleop.leaders.device import JointSource
    from duobench.teleop.policy_leader import PolicyLeader
    from duobench.teleop.teleop_page import TeleopPage
    from duobench.web.server import PageServer
    from duobench.world.robot.frames import Robot


@dataclass(frozen=True, kw_only=True, slots=True)
class LeadingOptions:
    """Options of a person or script that leads the arms."""

    operator: str = ""
    """Pseudonym of who leads; it is recorded."""
    leader: str | None = None
    """Leader arms in place of the page's hands: gello:FILE, a configuration of two GELLO arms, or
    lerobot:KIND, a teleoperator of LeRobot with our 16 numbers."""
    policy: str | None = None
    """Policy that plays, as duobench eval takes it, or NAME@ws://ADDRESS for one that is served: a
    squeeze takes over, and its release gives back."""
    instruction: str = ""
    """Instruction that the operator follows; the task's own if not given. Both are
    recorded."""
    limit: float = 600.0
    """Seconds that an episode may be led; while nothing is led they are not counted."""
    scripted: bool = False
    """A program leads through the page, which is recorded as such and never as a person."""
    lockstep: bool = False
    """A control step for each message of the page that leads, and none without messages: for
    machines that are too slow for real time, and on a rig for drivers without hardware."""

    def open(
        self,
        ending: ExitStack,
        find_policy: Callable[[str], PolicySource],
        robot: Robot,
    ) -> LedBy:
        """Open what leads the arms of a robot, which `ending` lets go of."""
        from duobench.data import Actor, ActorKind
        from duobench.teleop.hands import HandDevice
        from duobench.teleop.leaders.device import LeaderDevice

        self._check_words()
        if self.leader is None:
            device = HandDevice(lockstep=self.lockstep, robot=robot)
        else:
            arms = _joint_source(self.leader)
            arms.connect()
            ending.callback(arms.close)
            device = LeaderDevice(arms, robot)
        kind = ActorKind.SCRIPTED_OPERATOR if self.scripted else ActorKind.PERSON
        source = None
        if self.policy is not None:
            source = find_policy(self.policy)
            ending.callback(source.close)
        return LedBy(
            options=self,
            device=device,
            actor=Actor(kind=kind, name=self.operator, device=device.led_by or None),
            source=source,
        )

    def _check_words(self) -> None:
        """Reject words that the page would not take either."""
        import msgspec

        from duobench.teleop.messages import Instruction, Operator

        for option, kind, said in (
            ("--operator", Operator, {"name": self.operator}),
            ("--instruction", Instruction, {"text": self.instruction}),
        ):
            try:
                msgspec.convert(said, kind)
            except msgspec.ValidationError as error:
                raise AdvisedError(f"{option} cannot be recorded: {error}.") from error


@dataclass(frozen=True, kw_only=True, slots=True)
class LedBy:
    """Device of the operator, and the policy that plays, if one does."""

    options: LeadingOptions
    device: TeleopDevice
    actor: Actor
    """Operator as recorded."""
    source: PolicySource | None

    @property
    def recorder_settings(self) -> dict[str, Any]:
        """Settings of the environment that records."""
        return {
            "action_mode": self.device.action_mode,
            "metadata": None if self.source is None else self.source.metadata,
            "time_limit_s": self.options.limit,
        }

    def session_settings(self, env: gym.Env) -> dict[str, Any]:
        """Settings of a session in an environment."""
        return {
            "instruction": self.options.instruction,
            "lockstep": self.options.lockstep,
            "policy": self._play(env),
        }

    def _play(self, env: gym.Env) -> PolicyLeader | None:
        """The policy as it leads in an environment."""
        if self.source is None or self.options.policy is None:
            return None
        from duobench.evaluation.policies import actor_of, parse_choice
        from duobench.policy.policy import robot_note
        from duobench.teleop.policy_leader import PolicyLeader

        note = robot_note(self.source.metadata, env.get_wrapper_attr("config"))
        if note:
            say(note)
        choice = parse_choice(self.options.policy)
        return PolicyLeader(
            env,
            self.source.bind(env),
            actor_of(choice, self.source.metadata),
            waits=self.options.lockstep or choice.kind.is_scripted,
        )


def _joint_source(leader: str) -> JointSource:
    """The leader arms that an option names."""
    kind, _, what = leader.partition(":")
    if kind == "gello" and what:
        from duobench.teleop.leaders.gello import GelloConfig, GelloSource

        return GelloSource(GelloConfig.read(Path(what)))
    if kind == "lerobot" and what:
        from duobench.teleop.leaders.lerobot_source import LeRobotSource

        return LeRobotSource.make(what)
    raise AdvisedError(f"--leader is gello:FILE or lerobot:KIND, got {leader!r}.")


def lead(
    live: TeleopPage,
    server: PageServer,
    note: str,
    on_stop: Callable[[], None] = lambda: None,
) -> str:
    """Run a session on its page; what its times were, in a few words."""
    say(f"Open {server.url}\n{note}")

    def stop() -> None:
        live.stop()
        on_stop()

    with stopping(stop):
        summary = live.run().summary()
    if "latency_ms" not in summary:
        return ""
    period, latency = summary["period_ms"], summary["latency_ms"]
    return (
        f"; a control step every {period['p50']:.0f} ms (99 %: {period['p99']:.0f}), executed "
        f"{latency['p50']:.0f} ms after the hands' sample arrived"
    )
