"""Beginning an evaluation on real arms: policies, rig and folder put together."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, cast

from duobench.data import Actor, ActorKind, DataSet, Recorder
from duobench.data.rig import RigRecorder
from duobench.envs.config import EnvConfig
from duobench.errors import EvaluationError
from duobench.evaluation.policies import PolicyChoice, PolicySource, find_source
from duobench.hardware.clock import VirtualClock
from duobench.hardware.duo import FrankaDuo
from duobench.hardware.env import make_real_env
from duobench.policy.serving.address import RemoteServer
from duobench.results.limits import TimeLimits
from duobench.results.suite import TaskInfo
from duobench.rig_sessions.judging import PersonJudge
from duobench.rig_sessions.overlay import Overlay
from duobench.rig_sessions.players import Players
from duobench.rig_sessions.trial_folder import TrialsFolder
from duobench.rig_sessions.trial_plan import Plan, TrialPolicy, shuffled
from duobench.rig_sessions.trial_session import SILENCE_S, TrialsSession
from duobench.tasks import catalog
from duobench.versions import package_versions

if TYPE_CHECKING:
    import gymnasium as gym

    from duobench.tasks.task import Task
    from duobench.web.server import PageServer


@dataclass(frozen=True, kw_only=True, slots=True)
class Contender:
    """A policy that is to play."""

    spec: str
    """Its name, as `PolicyChoice.parse` takes it; `NAME@URL` for one that is served."""
    trained_on: str = ""
    """What it was trained on: "sim", "real" or "mixed"; empty if nobody said."""


def choose(spec: str) -> PolicyChoice:
    """A policy by its name, or by name and address.

    Raises:
        UnknownNameError: There is no policy of that name.
        PolicyError: The name is none, or lacks an address.
    """
    name, is_served, url = spec.partition("@")
    if is_served and url.startswith(("ws://", "wss://")):
        return PolicyChoice.parse(name, server=RemoteServer(url=url))
    return PolicyChoice.parse(spec)


def open_session(  # noqa: PLR0913 - everything that can be chosen
    folder: TrialsFolder,
    duo: FrankaDuo,
    task: TaskInfo,
    entries: Sequence[Contender],
    server: PageServer,
    ending: ExitStack,
    *,
    rater: str,
    episodes: int = 15,
    first_episode: int = 0,
    order_seed: int = 0,
    blind: bool = False,
    data: DataSet | None = None,
    command: str = "",
    silence_s: float = SILENCE_S,
) -> TrialsSession:
    """Begin an evaluation, or continue the one in the folder; nothing moves.

    Args:
        folder: Where everything is written.
        duo: The arms; they are started, and belong to the caller.
        task: What is to be done.
        entries: The policies.
        server: The operator's page.
        ending: Frees policies, renderer and log when it ends.
        rater: Who judges, by a pseudonym.
        episodes: Episodes of each policy.
        first_episode: Index of the first one.
        order_seed: Decides the order in which policies take turns, and blind ones get letters.
        blind: Whether the page hides their names until the end.
        data: Where trials that count are recorded, with all cameras of the rig; None records none.
        command: The command that started it, if there is one.
        silence_s: Seconds without a sign of the page after which the arms are held.

    Raises:
        DuoBenchError: A policy cannot be made or does not fit, the rig cannot be reached, or the
            folder holds another evaluation.
    """
    if not entries:
        raise EvaluationError("An evaluation needs at least one policy.")
    sources: dict[str, PolicySource] = {}
    policies: list[TrialPolicy] = []
    for entry in entries:
        if entry.spec in sources:
            raise EvaluationError(f"Named more than once: {entry.spec}. Name each policy once.")
        choice = choose(entry.spec)
        if choice.is_scripted:
            raise EvaluationError(
                f"{entry.spec} reads the simulation, which real arms do not have; name a policy "
                "that sees images."
            )
        sources[entry.spec] = source = find_source(choice, (task,), TimeLimits())
        ending.callback(source.close)
        policies.append(
            TrialPolicy(spec=entry.spec, metadata=source.metadata, trained_on=entry.trained_on)
        )
    plan = folder.begin(
        Plan(
            task=task,
            policies=shuffled(tuple(policies), order_seed) if blind else tuple(policies),
            rig=duo.rig.hash,
            rater=rater,
            episodes=episodes,
            first_episode=first_episode,
            order_seed=order_seed,
            blind=blind,
            versions=package_versions(),
        )
    )
    duo.start()
    duo.rig.write(folder.rig)
    judge = PersonJudge(task.max_stage)
    definition = cast("Task", catalog.get(task.reference))
    definition = replace(definition, horizon=task.horizon)
    overlay = Overlay(definition, duo.rig)
    ending.callback(overlay.close)

    def make(config: EnvConfig, person: PersonJudge, policy: TrialPolicy) -> gym.Env:
        options: dict[str, Any] = {
            "cameras": config.cameras,
            "image_size": config.image_size,
            "action_mode": config.action_mode,
            "horizon": config.horizon,
        }
        env = make_real_env(duo, task.reference, judge=person, **options)
        if data is None:
            return env
        metadata = policy.metadata
        actor = Actor(kind=ActorKind.POLICY, name=metadata.name, version=metadata.version)
        rig = RigRecorder(duo, waits=isinstance(duo.clock, VirtualClock))
        return Recorder(env, data, actor, is_reviewed=True, rig=rig)

    ordered = [sources[policy.spec] for policy in plan.policies]
    players = Players(plan, ordered, make, judge, command)
    players.prepare()
    session = TrialsSession(folder, plan, players, judge, duo, overlay, server, silence_s=silence_s)
    ending.callback(session.close)
    return session
