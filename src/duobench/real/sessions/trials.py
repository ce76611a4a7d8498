"""Evaluating policies on real arms: trials of a plan, which an operator places and judges.

Every press is written down at once, and a trial that counts becomes a record like that of an
episode in simulation.
"""

from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import replace
from datetime import UTC, datetime
from typing import Any, cast

from duobench.core.files import checksum, remove, write
from duobench.core.versions import (
    package_source,
    package_versions,
    record_versions,
    source_hashes,
)
from duobench.core.video import jpeg
from duobench.data import Actor, ActorKind, DataSet
from duobench.envs.config import LAYOUT, EnvConfig
from duobench.evaluation.policies import PolicySource
from duobench.evaluation.recorder import EpisodeRecorder
from duobench.evaluation.rollouts import Step
from duobench.printing.sheet import layout_sheet
from duobench.real.duo import FrankaDuo
from duobench.real.env import make_real_env
from duobench.real.judge import HumanJudge
from duobench.real.rig import Rig
from duobench.real.sessions.cameras import Film, head_image
from duobench.real.sessions.overlay import Overlay
from duobench.real.sessions.policy_runner import (
    PlayedEpisode,
    PolicyRunner,
    find_rig_policy,
    make_rig_recorder,
)
from duobench.real.sessions.session import Phase, RigSession, Stopped
from duobench.real.sessions.status_page import SILENCE_S, StatusPage
from duobench.real.sessions.trials_folder import (
    LogEntry,
    LogKind,
    TrialsFolder,
    TrialsProgress,
)
from duobench.real.sessions.trials_plan import RigEpisode, TrialsPlan, shuffled
from duobench.results.records import REAL, Judged, Record
from duobench.results.run import (
    Candidate,
    Run,
    TimeLimits,
    needed_options,
)
from duobench.results.suite import Suite, TaskInfo
from duobench.tasks import catalog
from duobench.tasks.task import Task
from duobench.web.server import PageServer
from duobench.world.sim.layout import Layout

RATER = "operator"
"""Rater where none is named."""
ASK_AT_END = "Say first whether the last stage still held at the end: yes or no."


class TrialsSession(RigSession):
    """Leads an operator through the trials of a plan, on one page.

    It begins an evaluation, or continues the one in the folder; nothing moves before `run`.

    Args:
        folder: Where everything is written.
        duo: The arms; they are started, and belong to the caller.
        task: What is to be done.
        policies: Of each policy its name, as `find_rig_policy` takes it, and what it was trained
            on: "sim", "real", "mixed", or "" if unknown.
        server: The operator's page.
        ending: Frees policies, renderer and log when it ends.
        rater: Who judges in this session, by a pseudonym; empty is who began the evaluation.
        episodes: Episodes of each policy.
        first_episode: Index of the first one.
        order_seed: Decides the order in which policies take turns, and the letters of blind ones.
        blind: Whether the page hides until the end which policy plays.
        data: Where trials that count are recorded, with all cameras of the rig; None records none.
        command: The command that started it, if there is one.
        silence_s: Seconds without a sign of the page after which the arms are held.
    """

    def __init__(  # noqa: PLR0913 - everything that can be chosen
        self,
        folder: TrialsFolder,
        duo: FrankaDuo,
        task: TaskInfo,
        policies: Sequence[tuple[str, str]],
        server: PageServer,
        ending: ExitStack,
        *,
        rater: str = "",
        episodes: int = 15,
        first_episode: int = 0,
        order_seed: int = 0,
        blind: bool = False,
        data: DataSet | None = None,
        command: str = "",
        silence_s: float = SILENCE_S,
    ) -> None:
        sources: dict[str, PolicySource] = {}
        for name, _ in policies:
            sources[name] = find_rig_policy(name, (task,))
            ending.callback(sources[name].close)
        candidates = tuple(
            _candidate(name, trained_on, sources[name], task, duo.rig)
            for name, trained_on in policies
        )
        run = Run(
            candidates=shuffled(candidates, order_seed) if blind else candidates,
            suite=Suite(tasks=(task,), episodes=episodes, first_episode=first_episode),
            limits=TimeLimits(),
            versions=package_versions(),
            sources=source_hashes(),
            package=package_source(),
            domain=REAL,
            rig=checksum(duo.rig.chosen),
        )
        folder.check_rig(duo.rig)
        duo.start()  # first, so that what cannot be reached begins nothing
        plan = folder.begin(
            TrialsPlan(
                run=run, rater=rater or RATER, order_seed=order_seed, blind=blind
            )
        )
        differing = folder.compared()
        self._rater = rater or plan.rater
        folder.keep_rig(duo.rig)
        super().__init__(duo, HumanJudge(plan.task.max_stage, duo.clock.now))
        definition = cast(Task, catalog.get(task.reference))
        self.message = differing
        self._overlay = Overlay(replace(definition, horizon=task.horizon), duo.rig)
        ending.callback(self._overlay.close)
        self._folder = folder
        self._plan = plan
        self._server = server
        self._runners = [
            self._runner(candidate, sources[candidate.policy], data)
            for candidate in plan.policies
        ]
        for runner in self._runners:
            ending.callback(runner.forget)
            ending.callback(runner.asked.close)
        self._log = folder.open_log(_now())
        ending.callback(self._log.close)
        self._progress = TrialsProgress.of(self._log.entries)
        self._trial: RigEpisode | None = None
        self._layout: Layout | None = None
        self._attempt = 0
        with folder.run.writer() as journal:
            folder.run.begin(plan.run)
            journal.start(command, 1)
            for trial in folder.remaining(plan, self._progress):
                folder.run.discard(plan.key(trial))  # what the log does not count
        self.view = self._page = StatusPage(self, server, self._overlay, silence_s)

    def run(self) -> bool:
        """Play the missing trials; return whether the plan is complete."""
        try:
            for trial in self._folder.remaining(self._plan, self._progress):
                while not self._play_once(trial):
                    pass
        except Stopped:
            return False
        finally:
            self.duo.hold("The session is over.")
        self.phase = Phase.OVER
        self._page.publish()
        return True

    def publish(self, **more: object) -> None:
        """Show the state on the page, with what else is to be said."""
        self._page.more = more
        self._page.publish()

    def write(self, kind: LogKind, **more: Any) -> None:
        """Write a line about the trial into the log."""
        if self._trial is not None:
            number, attempt = self._trial.number, self._attempt
            self._log.add(
                LogEntry(
                    kind=kind,
                    trial=number,
                    attempt=attempt,
                    at=_now(),
                    **more,
                )
            )

    def on_step(self, step: Step) -> None:
        """Show how it goes."""
        super().on_step(step)
        self._page.on_step(step.number)

    def keep_placed(self) -> None:
        """Store what the head camera sees."""
        if self._layout is not None:
            self.duo.place(self._overlay.task, self._layout)
        image = head_image(self.duo)
        if image is not None and self._trial is not None:
            write(self._folder.placed(self._trial.number, self._attempt), jpeg(image))

    def objection(self, played: PlayedEpisode) -> str:
        """Reason why a trial cannot count as judged; first of all whether a success held."""
        is_solved = self.judge.labels.stage == self.judge.max_stage
        unsaid = ASK_AT_END if is_solved and self.at_end is None else ""
        return super().objection(played) or unsaid

    def _play_once(self, trial: RigEpisode) -> bool:
        """Play a trial once; whether it counts."""
        self._trial, self._progress = trial, TrialsProgress.of(self._log.entries)
        self._attempt = self._progress.attempts.get(trial.number, 0) + 1
        self.begin()
        episode = self._plan.episode(trial)
        self._layout = layout = self._overlay.layout(episode.seed, episode.split)
        self._page.begin(layout, self._about(trial, layout))
        name = f"episode {trial.episode}"
        self._page.offer_sheet(
            f"sheet-{trial.episode}", layout_sheet(self._overlay.task, layout, name)
        )
        self.write(LogKind.BEGIN, text=self._plan.letter(trial.policy))
        runner = self._runners[trial.policy]
        while True:
            self.place()
            recorder = EpisodeRecorder(episode)
            film = Film(self.duo, self._server.publish_frame)
            played = self.play(runner, episode.seed, {LAYOUT: layout}, recorder, film)
            if played.has_begun:
                break
            runner.forget()
        name = f"{trial.number}.{self._attempt}"
        invalid_film = self._folder.invalid_film(trial.number, self._attempt)
        video = film.video()
        if video is not None:
            write(invalid_film, video)  # until it counts
            self._page.offer_film(f"film-{name}", video)
        automatic = self.lost or played.invalid
        reason = automatic or self.decide(played, played.ending)
        if reason:
            runner.forget()
            has_no_choice = bool(automatic or played.reasons)
            self.write(
                LogKind.INVALID, text=reason, yes=has_no_choice, fault=played.fault
            )
            self.message = f"The trial is invalid and comes again: {reason}"
            return False
        self._folder.run.write(self._record(trial, recorder, played), video)
        if played.steps:
            runner.keep(self.judge.labels, holds=bool(self.at_end))
        else:
            runner.forget()
        self.write(LogKind.VALID)
        remove(invalid_film)
        self.message = ""
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
    ) -> Record:
        labels = self.judge.labels
        policy = self._plan.policies[trial.policy].policy
        plain = recorder.record(self._plan.run, record_versions(None), policy)
        success = labels.stage == plain.max_stage
        record = replace(
            plain,
            stage_changes=labels.changes(),
            final_stage=labels.stage,
            success=success,
            success_at_end=success and bool(self.at_end),
            unmet=None,
            domain=REAL,
            rig=self.duo.rig.hash,
            judged=Judged(
                rater=self._rater,
                presses=labels.all,
                note=self.note,
                repeated=tuple(
                    TrialsProgress.of(self._log.entries).invalid.get(trial.number, ())
                ),
                stopped=played.stopped,
                fault=played.fault,
                waits=played.waits,
            ),
        )
        return (
            record
            if played.error is None
            else record.broken(played.error, played.steps)
        )

    def _runner(
        self, candidate: Candidate, source: PolicySource, data: DataSet | None
    ) -> PolicyRunner:
        metadata = source.metadata
        env = make_real_env(
            self.duo,
            self._plan.task.reference,
            judge=self.judge,
            horizon=candidate.config.horizon,
            **needed_options(metadata),
        )
        if data is not None:
            actor = Actor(
                kind=ActorKind.POLICY, name=metadata.name, version=metadata.version
            )
            env = make_rig_recorder(env, self.duo, data, actor)
        return PolicyRunner(env, source)


def _candidate(
    name: str, trained_on: str, source: PolicySource, task: TaskInfo, rig: Rig
) -> Candidate:
    metadata = source.metadata
    usual = catalog.get(task.reference).horizon
    return Candidate(
        policy=name,
        metadata=metadata,
        config=EnvConfig(
            **needed_options(metadata),
            horizon=None if task.horizon == usual else task.horizon,
            gripper=rig.gripper,
            mount=rig.mount,
        ),
        batching=source.batching,
        trained_on=trained_on,
    )


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="seconds")
