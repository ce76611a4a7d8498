"""Evaluating policies on real arms: trials of a plan, which an operator places and judges.

Every press is written down at once, and a trial that counts becomes a record like that of an
episode in simulation.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import replace
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any, cast

from duobench.data import Actor, ActorKind, DataSet
from duobench.envs.config import IMAGE_SIZE, LAYOUT, EnvConfig
from duobench.evaluation.policies import PolicySource
from duobench.evaluation.recorder import EpisodeRecorder
from duobench.fabrication.sheet import layout_sheet
from duobench.files import write
from duobench.hardware.devices import FaultKind
from duobench.hardware.duo import FrankaDuo
from duobench.hardware.env import make_real_env
from duobench.hardware.judge import HumanJudge
from duobench.results.limits import TimeLimits
from duobench.results.records import REAL, EpisodeRecord, Judged
from duobench.results.run import Candidate, Run
from duobench.results.suite import Suite, TaskInfo
from duobench.rig_sessions.cameras import Film, jpeg
from duobench.rig_sessions.overlay import Overlay
from duobench.rig_sessions.policy_runner import (
    PlayedEpisode,
    PolicyRunner,
    find_rig_policy,
    make_rig_recorder,
)
from duobench.rig_sessions.session import Phase, RigSession, Stopped
from duobench.rig_sessions.status_page import SILENCE_S, StatusPage
from duobench.rig_sessions.trials_folder import TrialsFolder, TrialsProgress
from duobench.rig_sessions.trials_log import LogEntry, LogKind, TrialLog
from duobench.rig_sessions.trials_plan import RigEpisode, TrialsPlan, shuffled
from duobench.sim.layout import Layout
from duobench.tasks import catalog
from duobench.versions import package_versions, record_versions
from duobench.web.server import PageServer

if TYPE_CHECKING:
    from duobench.tasks.task import Task


class TrialsSession(RigSession):
    """Leads an operator through the trials of a plan, on one page; nothing moves before `run`.

    Args:
        folder: Where everything is written.
        plan: The plan that the folder holds.
        sources: The policies, in the order of the plan.
        duo: The arms, started.
        overlay: Layouts and their images.
        server: The page, which takes its messages here from now on.
        data: Where trials that count are recorded; None records none.
        command: The command that started it, if there is one.
        silence_s: Seconds without a sign of the page after which the arms are held.
        wall: Date and time of day, for the log.

    Raises:
        DuoBenchError: A policy does not fit the rig, or the log is damaged.
    """

    def __init__(  # noqa: PLR0913 - its parts
        self,
        folder: TrialsFolder,
        plan: TrialsPlan,
        sources: Sequence[PolicySource],
        duo: FrankaDuo,
        overlay: Overlay,
        server: PageServer,
        *,
        data: DataSet | None = None,
        command: str = "",
        silence_s: float = SILENCE_S,
        wall: Callable[[], str] = lambda: datetime.now(UTC).isoformat(timespec="seconds"),
    ) -> None:
        super().__init__(duo, HumanJudge(plan.task.max_stage, duo.clock.now))
        self._folder, self._plan, self._overlay, self._wall = folder, plan, overlay, wall
        self._runners = [
            self._runner(candidate, source, data)
            for candidate, source in zip(plan.policies, sources, strict=True)
        ]
        self._log: TrialLog = folder.open_log(wall())
        self._progress = TrialsProgress.of(self._log.entries)
        self._trial: RigEpisode | None = None
        self._attempt = 0
        with folder.run.writer() as journal:
            folder.run.begin(plan.run)
            journal.start(command, 1)
        self.view = self._page = StatusPage(self, server, overlay, silence_s)

    def run(self) -> bool:
        """Play what is missing; whether nothing is missing at the end.

        Raises:
            OutputError: Something cannot be written.
        """
        try:
            for trial in self._folder.remaining(self._plan, self._progress):
                while not self._play_once(trial):
                    self._progress = TrialsProgress.of(self._log.entries)
        except Stopped:
            return False
        finally:
            self.duo.hold("The session is over.")
        self.phase = Phase.OVER
        self._page.publish()
        return True

    def close(self) -> None:
        """Let go of the log; closing twice is harmless."""
        self._log.close()

    def publish(self, **more: object) -> None:
        """Show the state on the page, with what else is to be said."""
        self._page.more = more
        self._page.publish()

    def write(self, kind: LogKind, **more: Any) -> None:
        """Write a line about the trial into the log."""
        if self._trial is not None:
            number, attempt = self._trial.number, self._attempt
            self._log.add(
                LogEntry(kind=kind, trial=number, attempt=attempt, at=self._wall(), **more)
            )

    def on_step(self, number: int) -> None:
        """Hold where nobody is at the page, and show how it goes."""
        self._page.on_step(number)

    def keep_placed(self) -> None:
        """Store what the head camera sees."""
        image = self._page.native_image()
        if image is not None and self._trial is not None:
            write(self._folder.placed(self._trial.number, self._attempt), jpeg(image))

    def _play_once(self, trial: RigEpisode) -> bool:
        """Play a trial once; whether it counts."""
        self._trial = trial
        self._attempt = self._progress.attempts.get(trial.number, 0) + 1
        self.begin()
        episode = self._plan.episode(trial)
        layout = self._overlay.layout(episode.seed, episode.split)
        self._page.begin(layout, self._about(trial, layout))
        name = f"episode {trial.episode}"
        self._page.offer_sheet(
            f"sheet-{trial.episode}", layout_sheet(self._overlay.task, layout, name)
        )
        self.write(LogKind.BEGIN, text=self._plan.letter(trial.policy))
        self.place()
        recorder = EpisodeRecorder(episode)
        film = Film(self._page.head.image, self._page.show_frame)
        runner = self._runners[trial.policy]
        played = self.play(runner, episode.seed, {LAYOUT: layout}, recorder, film)
        name = f"{trial.number}.{self._attempt}"
        if (video := film.video()) is not None:
            self._page.offer_film(f"film-{name}", video)
        automatic = self.lost or played.invalid
        if reason := automatic or self.decide(played, played.ending):
            if video is not None:
                write(self._folder.invalid_film(trial.number, self._attempt), video)
            runner.settle(counts=False)
            self.write(LogKind.INVALID, text=reason, yes=bool(automatic))
            self.message = f"The trial is invalid and comes again: {reason}"
            return False
        self._keep(trial, self._record(trial, recorder, played), video)
        return True

    def _about(self, trial: RigEpisode, layout: Layout) -> dict[str, Any]:
        plan, task = self._plan, self._overlay.task
        return {
            "title": plan.task.title,
            "task": plan.task.id,
            "blind": plan.blind,
            "stages": list(plan.task.stages),
            "horizon": plan.task.horizon,
            "sheet": "",
            "trial": {
                "number": trial.number + 1,
                "of": len(plan.trials()),
                "attempt": self._attempt,
                "episode": trial.episode,
                "policy": plan.shown_name(trial.policy),
                "invalid": sum(map(len, self._progress.invalid.values())),
                "instruction": task.instruct(layout),
                "variants": dict(layout.variants),
            },
        }

    def _record(
        self, trial: RigEpisode, recorder: EpisodeRecorder, played: PlayedEpisode
    ) -> EpisodeRecord:
        labels = self.judge.labels
        policy = self._plan.policies[trial.policy].policy
        plain = recorder.record(self._plan.run, record_versions(None), policy)
        success = labels.stage == plain.max_stage
        record = replace(
            plain,
            stage_changes=labels.changes(),
            final_stage=labels.stage,
            success=success,
            success_at_end=success and self.at_end is not False,
            unmet=None,
            domain=REAL,
            rig=self._plan.run.rig,
            judged=Judged(
                rater=self._plan.rater,
                presses=labels.all,
                note=self.note,
                repeated=tuple(self._progress.invalid.get(trial.number, ())),
                stopped=played.stopped,
                reflex=played.fault is FaultKind.REFLEX,
            ),
        )
        return record if played.error is None else record.broken(played.error, played.steps)

    def _keep(self, trial: RigEpisode, record: EpisodeRecord, video: bytes | None) -> None:
        self._folder.run.write(record, video)
        self._runners[trial.policy].settle(counts=True)
        self.write(LogKind.VALID)
        self._progress = TrialsProgress.of(self._log.entries)
        self.message = ""

    def _runner(
        self, candidate: Candidate, source: PolicySource, data: DataSet | None
    ) -> PolicyRunner:
        config, metadata = candidate.config, source.metadata
        env = make_real_env(
            self.duo,
            self._plan.task.reference,
            judge=self.judge,
            cameras=config.cameras,
            image_size=config.image_size,
            action_mode=config.action_mode,
            horizon=config.horizon,
        )
        if data is not None:
            actor = Actor(kind=ActorKind.POLICY, name=metadata.name, version=metadata.version)
            env = make_rig_recorder(env, self.duo, data, actor)
        return PolicyRunner(env, source)


def _candidate(name: str, trained_on: str, source: PolicySource, task: TaskInfo) -> Candidate:
    metadata = source.metadata
    usual = catalog.get(task.reference).horizon
    return Candidate(
        policy=name,
        metadata=metadata,
        config=EnvConfig(
            cameras=metadata.cameras,
            object_state=metadata.object_state,
            action_mode=metadata.action_mode,
            control_rate_hz=metadata.control_rate_hz,
            image_size=metadata.image_size or IMAGE_SIZE,
            horizon=None if task.horizon == usual else task.horizon,
        ),
        batching=source.batching,
        trained_on=trained_on,
    )


def open_session(  # noqa: PLR0913 - everything that can be chosen
    folder: TrialsFolder,
    duo: FrankaDuo,
    task: TaskInfo,
    policies: Sequence[tuple[str, str]],
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
        policies: Of each policy its name, as `find_rig_policy` takes it, and what it was trained
            on: "sim", "real", "mixed", or "" if nobody said.
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
    sources: dict[str, PolicySource] = {}
    candidates: list[Candidate] = []
    for name, trained_on in policies:
        sources[name] = source = find_rig_policy(name, (task,))
        ending.callback(source.close)
        candidates.append(_candidate(name, trained_on, source, task))
    run = Run(
        candidates=shuffled(tuple(candidates), order_seed) if blind else tuple(candidates),
        suite=Suite(tasks=(task,), episodes=episodes, first_episode=first_episode),
        limits=TimeLimits(),
        versions=package_versions(),
        domain=REAL,
        rig=duo.rig.hash,
    )
    plan = folder.begin(TrialsPlan(run=run, rater=rater, order_seed=order_seed, blind=blind))
    duo.start()
    duo.rig.write(folder.rig)
    definition = cast("Task", catalog.get(task.reference))
    overlay = Overlay(replace(definition, horizon=task.horizon), duo.rig)
    ending.callback(overlay.close)
    session = TrialsSession(
        folder,
        plan,
        [sources[candidate.policy] for candidate in plan.policies],
        duo,
        overlay,
        server,
        data=data,
        command=command,
        silence_s=silence_s,
    )
    ending.callback(session.close)
    return session
