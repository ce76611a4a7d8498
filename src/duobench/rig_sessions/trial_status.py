"""What the operator's page shows: the trial, the outlines, the stages, and what may be done."""

from __future__ import annotations

from enum import StrEnum
from typing import Any, ClassVar

import numpy as np

from duobench.hardware.devices import Fault
from duobench.rig_sessions.footprints import Footprint, footprints, project
from duobench.rig_sessions.judging import PersonJudge
from duobench.rig_sessions.trial_folder import Standing
from duobench.rig_sessions.trial_plan import Plan, Trial
from duobench.robot.cameras import NATIVE_HEIGHT, NATIVE_WIDTH
from duobench.sim.layout import Layout
from duobench.spatial import SE3
from duobench.tasks import catalog
from duobench.types import CONTROL_HZ, Array


class Phase(StrEnum):
    """What the session waits for."""

    PLACING = "placing"
    """The operator puts the objects where the layout says."""
    READY = "ready"
    """They lie there; the operator may start the policy."""
    MOVING = "moving"
    """The arms go home."""
    PLAYING = "playing"
    """The policy plays."""
    JUDGING = "judging"
    """It is over; the operator says what came of it."""
    OVER = "over"
    """Every trial is played."""


class Board:
    """Everything that the page shows, kept for whoever opens it later."""

    EVERY: ClassVar[int] = 3
    """Control steps from one status of a running episode to the next."""

    def __init__(self, plan: Plan, judge: PersonJudge, table_from_head: SE3) -> None:
        """Begin before the first trial.

        Args:
            plan: What is played.
            judge: Who knows the stage.
            table_from_head: Pose of the head camera, for outlines in its image.
        """
        self._plan, self._judge, self._table_from_head = plan, judge, table_from_head
        self._total = len(plan.trials())
        self._definition = catalog.get(plan.task.reference)
        self.phase = Phase.PLACING
        """What the session waits for."""
        self.message = ""
        """What else there is to say."""
        self.note = ""
        """The operator's remark about the trial."""
        self.at_end: bool | None = None
        """Whether the last stage still held; None if nobody said."""
        self.images: dict[str, str] = {}
        """Addresses of images by what they show."""
        self.sheet = ""
        """Address of the footprints to print; empty if there is none."""
        self.film = ""
        """Address of the film of a trial that is over; empty if there is none."""
        self.more: dict[str, Any] = {}
        """What is shown at the end."""
        self._trial: dict[str, Any] = {}
        self._footprints: list[dict[str, Any]] = []
        self._image_count = 0

    def begin(self, trial: Trial, attempt: int, layout: Layout, standing: Standing) -> None:
        """Show another trial.

        Args:
            trial: The trial.
            attempt: How often it was tried with this one.
            layout: Where the objects shall lie.
            standing: How far the evaluation is.
        """
        self.note, self.at_end, self.images, self.film = "", None, {}, ""
        self._trial = {
            "number": trial.number + 1,
            "of": self._total,
            "attempt": attempt,
            "episode": trial.episode,
            "policy": self._plan.shown_name(trial.policy),
            "done": len(standing.valid),
            "invalid": sum(map(len, standing.invalid.values())),
            "instruction": self._definition.instruct(layout),
            "variants": dict(layout.variants),
        }
        self._footprints = [
            self._footprint(each) for each in footprints(self._definition.props, layout)
        ]

    def next_image(self) -> int:
        """A number that no image had yet."""
        self._image_count += 1
        return self._image_count

    def status(self, fault: Fault | None, held: str | None) -> dict[str, Any]:
        """The state as JSON data.

        Args:
            fault: What is wrong with the arms, if anything.
            held: Why they are held, if they are.
        """
        presses = self._judge.presses
        steps = self._judge.steps
        return {
            "title": self._plan.task.title,
            "task": self._plan.task.id,
            "phase": self.phase.value,
            "trial": self._trial,
            "blind": self._plan.blind,
            "stages": list(self._plan.task.stages),
            "stage": presses.stage,
            "changes": presses.changes(),
            "presses": [
                {"stage": press.stage, "step": press.step, "time_s": press.time_s}
                for press in presses.all
            ],
            "step": steps,
            "horizon": self._plan.task.horizon,
            "time_s": round(steps / CONTROL_HZ, 1),
            "at_end": self.at_end,
            "note": self.note,
            "message": self.message,
            "fault": None if fault is None else fault.text,
            "held": held,
            "image_size": [NATIVE_WIDTH, NATIVE_HEIGHT],
            "images": self.images,
            "sheet": self.sheet,
            "film": self.film,
            "footprints": self._footprints,
            **self.more,
        }

    def _footprint(self, each: Footprint) -> dict[str, Any]:
        return {
            "number": each.number,
            "name": each.name.replace("_", " "),
            "x_mm": each.x_mm,
            "y_mm": each.y_mm,
            "z_mm": each.z_mm,
            "yaw_deg": each.yaw_deg,
            "outlines": [self._in_image(outline) for outline in each.contact or each.seen],
        }

    def _in_image(self, outline: Array) -> list[list[float]]:
        """An outline on the table in pixels of the head camera; empty where it is behind that."""
        on_table = np.column_stack([outline, np.zeros(len(outline))])
        corners = project(on_table, self._table_from_head)
        return [] if np.isnan(corners).any() else corners.round(1).tolist()
