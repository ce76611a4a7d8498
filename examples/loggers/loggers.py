"""Observers that log an evaluation to Weights & Biases or to TensorBoard.

    duobench eval --policy my_policy:MyPolicy --out runs/mine --observer loggers:WandB
    duobench eval --policy my_policy:MyPolicy --out runs/mine --observer loggers:TensorBoard

DuoBench installs neither: `pip install wandb`, or `pip install tensorboard torch`.
"""

from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Sequence

from duobench.results import Record, Run


class Logger(ABC):
    """Log success rates, of all episodes so far, and the numbers of each episode."""

    def __init__(self) -> None:
        self.episodes: Counter[str] = Counter()
        self.successes: Counter[str] = Counter()

    def on_run_start(self, run: Run, finished: Sequence[Record]) -> None:
        """Begin; episodes of earlier commands count in the rates."""
        self.begin(run)
        for record in finished:
            self.count(record)

    def on_episode(self, played: Record) -> None:
        """Log one more episode."""
        self.count(played)
        task = played.task
        numbers = {
            f"{task}/success": float(played.success),
            f"{task}/progress": played.final_stage / played.max_stage,
            f"{task}/steps": float(played.steps),
            f"{task}/success_rate": self.successes[task] / self.episodes[task],
            "success_rate": self.successes.total() / self.episodes.total(),
        }
        self.log(numbers, self.episodes.total())

    def count(self, record: Record) -> None:
        """Count an episode of a task."""
        self.episodes[record.task] += 1
        self.successes[record.task] += record.success

    @abstractmethod
    def begin(self, run: Run) -> None:
        """Begin to log a run."""

    @abstractmethod
    def log(self, numbers: dict[str, float], episode: int) -> None:
        """Log numbers after so many episodes."""


class WandB(Logger):
    """Log to Weights & Biases; commands of one evaluation are one group of runs."""

    def begin(self, run: Run) -> None:
        """Begin a run of Weights & Biases."""
        import wandb

        self._wandb = wandb
        self._wandb.init(
            project="duobench",
            group=run.hash[:16],
            name=run.candidate.policy,
            config={"policy": run.candidate.policy, "suite": run.suite.label},
        )

    def log(self, numbers: dict[str, float], episode: int) -> None:
        """Log to it."""
        self._wandb.log({**numbers, "episode": episode})


class TensorBoard(Logger):
    """Log for TensorBoard, into the folder `logs`."""

    def begin(self, run: Run) -> None:
        """Begin a file of events."""
        from torch.utils.tensorboard import SummaryWriter

        self._writer = SummaryWriter("logs")
        self._writer.add_text("policy", run.candidate.policy)

    def log(self, numbers: dict[str, float], episode: int) -> None:
        """Write into it."""
        for name, value in numbers.items():
            self._writer.add_scalar(name, value, episode)
        self._writer.flush()
