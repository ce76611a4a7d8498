"""Commands and options that people know from other programs; tyro tells every other mistake."""

from collections.abc import Collection, Sequence
from difflib import get_close_matches

COMMANDS = {
    **dict.fromkeys(("evaluate", "test", "run", "rollout", "benchmark"), "eval"),
    **dict.fromkeys(("teleoperate", "collect", "generate"), "record"),
    "visualize": "replay",
    "help": "--help",
}
OPTIONS = {
    "camera cameras obs": "Cameras are named by the policy: PolicyMetadata(cameras=(...)).",
    "gpu gpus device cuda": "A policy chooses its device itself; on Ray there is --policy-gpus.",
    "headless render gui viewer": "No window is opened; duobench view shows tasks and runs.",
    "seed seeds": "Seeds follow from task and episode; duobench eval has --first-episode.",
    "model checkpoint ckpt": "A checkpoint of LeRobot is a policy: --policy lerobot:PATH.",
    "env environment": "What is played is a task: --tasks bin_sort.",
    "num-envs n-envs num-processes": "Episodes are played side by side by --workers 4.",
    "resume continue": "The same command in the same folder goes on where it was stopped.",
    "horizon max-steps": "The task fixes its horizon.",
    "operator rater": "Who leads is --operator (teleop); who judges is --rater (real eval).",
    "batch-size lr": "Options of lerobot-train come last, after --: -- --batch_size=8.",
}


def meant_command(
    word: str,
    program: str,
    known: Collection[str],
) -> str:
    """Return a hint where `program`, such as "duobench data", has no command of a name."""
    for name in [COMMANDS.get(word, ""), *get_close_matches(word, known, n=1)]:
        if name in known or name.startswith("--"):
            return f"Did you mean `{program} {name}`?"
    if len(known) == 1:
        return f"Did you mean `{program} {next(iter(known))} {word}`?"
    return f"There are: {', '.join(known)}."


def hints(words: Sequence[str], known: Collection[str]) -> list[str]:
    """Return what stands in place of options that a command, with those `known`, does not have."""
    flags = {word.partition("=")[0].replace("_", "-") for word in words} - {*known}
    names = [flag[2:] for flag in sorted(flags) if flag.startswith("--")]
    return [text for each, text in OPTIONS.items() if {*each.split()} & {*names}]
