"""The order of the site: drawers, their chapters, and the pages in them."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from duobench.tasks import catalog

Chapters = Mapping[str, tuple[str, ...]]
"""Names of pages, by the heading that they stand under; one without a heading is "" ."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Drawer:
    """One of the parts that the site has."""

    title: str
    about: str
    """What is in it, in a sentence."""
    chapters: Chapters


DRAWERS: Mapping[str, Drawer] = {
    "start": Drawer(
        title="Start",
        about="Install it, evaluate a policy, write one, add a task.",
        chapters={"": ("install", "commands", "policies", "add_a_task")},
    ),
    "tasks": Drawer(
        title="Tasks",
        about="A page for each task: how it looks, what counts, what does not.",
        chapters={
            "The eleven tasks": tuple(catalog.names()),
            "All tasks": ("gallery", "stages", "object_states", "looks"),
            "In plastic": ("printing", "printing_parts"),
        },
    ),
    "guides": Drawer(
        title="Guides",
        about="How something is done, from an environment to real arms.",
        chapters={
            "Environments and learning": (
                "environments",
                "reinforcement_learning",
                "other_hardware",
            ),
            "Record and teleoperate": (
                "recording",
                "parquet",
                "viewing",
                "teleoperation",
                "teleoperation_controls",
                "people",
                "lerobot_teleoperation",
            ),
            "Train and serve": (
                "lerobot",
                "lerobot_policies",
                "authors_data",
                "own_learners",
                "serving",
            ),
            "Evaluate, compare, verify, publish": (
                "evaluation",
                "comparison",
                "robustness",
                "verification",
                "publish",
            ),
            "Scale": ("scale", "performance"),
            "Real arms": (
                "real_arms",
                "real_safety",
                "real_setup",
                "real_cameras",
                "real_recording",
                "real_evaluation",
                "lerobot_robot",
            ),
        },
    ),
    "reference": Drawer(
        title="Reference",
        about="Every name, option, field, frame and message.",
        chapters={
            "Look it up": (
                "python",
                "command_line",
                "options",
                "schemas",
                "frames",
                "messages",
            ),
            "Measured": ("results", "baselines"),
        },
    ),
    "project": Drawer(
        title="Project",
        about="How to change DuoBench, what is defended, what changed, licences.",
        chapters={"": ("contributing", "security", "changelog", "conduct", "notices")},
    ),
}
"""By folder. `project` holds the pages beside the first one, which are no part of docs/."""
KEYWORDS: Mapping[str, str] = {
    "index": "bibtex license",
    "install": "headless macos windows",
    "environments": "jupyter colab mjcf",
    "lerobot": "wandb hugging face huggingface",
    "publish": "hugging face huggingface license",
    "frames": "end effector eef urdf",
    "looks": "color",
    "printing": "color",
    "notices": "urdf mjcf",
}
"""Words of others, which the search finds on pages that say it otherwise."""
UNTRIED = "Real arms"
"""The chapter above which stands that nothing of it was tried on hardware."""


def pages(drawer: str) -> Iterator[str]:
    """Give the names of a drawer's pages, in order."""
    for names in DRAWERS[drawer].chapters.values():
        yield from names
