"""An agent at a server of VLAgents 0.3 as a policy, for `duobench serve --policy`."""

from importlib.metadata import PackageNotFoundError, version

from duobench.core.errors import DuoBenchError
from duobench.policy import Policy

_NEEDED = {"vlagents": ("0.3.", "0.3.0"), "rpyc": ("6.", "6")}
"""What versions begin with, and the first of them; before RPyC 6, every client can run code
(CVE-2024-27758)."""


def served_agent() -> Policy:
    """The agent at a server that the environment variable DUOBENCH_VLAGENTS_AGENT names."""
    check_versions()
    from duobench.evaluation.interop.vlagents_bridge import VLAgentsPolicy

    return VLAgentsPolicy()


def check_versions() -> None:
    """Reject packages of other versions, whose observations and actions mean something else."""
    for name, (start, first) in _NEEDED.items():
        try:
            installed = version(name)
        except PackageNotFoundError:
            installed = ""
        if not installed.startswith(start):
            what = f"{name} {installed} is installed" if installed else f"{name} is not installed"
            raise DuoBenchError(
                f"This needs {name} {first}, or a later version that begins with {start}; {what}. "
                "pip install 'vlagents==0.3.0' 'rpyc>=6,<7'"
            )
