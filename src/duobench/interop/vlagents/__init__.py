"""The tasks as environments, policies as an agent, and agents as policies, of VLAgents 0.3.

VLAgents imports no module of anybody else, so its programs are started from here:
`python -m duobench.interop.vlagents` has their verbs and options. In code, `register` is enough.
"""

from __future__ import annotations

from importlib import import_module
from importlib.metadata import PackageNotFoundError, version

from duobench.errors import DuoBenchError
from duobench.policy import Policy
from duobench.tasks import catalog

AGENT = "duobench"
"""The name of the agent that answers with a policy of DuoBench."""
_NEEDED = {"vlagents": ("0.3.", "0.3.0"), "rpyc": ("6.", "6")}
"""What versions begin with, and the first of them; before RPyC 6, every client can run code
(CVE-2024-27758)."""


def register() -> None:
    """Make tasks and policies known to VLAgents in this process.

    Its environments `duobench/<task>` are then those of this package, and its agent `duobench` is
    a policy.

    Raises:
        DuoBenchError: If VLAgents is missing, or of another version.
    """
    check_versions()
    from duobench.interop.vlagents.agent import PolicyAgent
    from duobench.interop.vlagents.environment import TaskEnv

    theirs = import_module("vlagents")
    for name in catalog.names():
        theirs.register_env(f"duobench/{name}", TaskEnv)
    theirs.register_agent(AGENT, PolicyAgent)


def served_agent() -> Policy:
    """The agent at a server of VLAgents that the environment names, for `duobench serve --policy`.

    Raises:
        DuoBenchError: If VLAgents is missing, or of another version, or there is no such agent.
    """
    check_versions()
    from duobench.interop.vlagents.bridge import VLAgentsPolicy

    return VLAgentsPolicy()


def check_versions() -> None:
    """Reject packages of other versions, whose observations and actions mean something else.

    Raises:
        DuoBenchError: If a package is missing, or of another version.
    """
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
