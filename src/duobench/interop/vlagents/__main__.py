"""VLAgents' programs, with the tasks and policies of DuoBench: `python -m` and this package.

The verbs and options are VLAgents' own. A server that is started here lets clients reach nothing
but the methods that it offers, unpickles nothing, and tells nothing about its folder.
"""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from importlib import import_module
from typing import Any

from duobench.errors import DuoBenchError, ServingError, check_known
from duobench.interop.vlagents import AGENT, register
from duobench.machine import is_loopback

_END_S = 10.0
"""Seconds that a server may take to end."""


def main() -> None:
    """Register everything, and run a verb of VLAgents."""
    try:
        register()
        _app()()
    except DuoBenchError as error:
        sys.exit(f"error: {error}")


def start_server(
    agent_name: str,
    kwargs: str = "{}",
    port: int = 8080,
    host: str = "localhost",
    let_anybody_connect: bool = False,
) -> None:
    """Serve an agent until Ctrl-C.

    The agent "duobench" answers with a policy of DuoBench: --kwargs='{"policy": "hold"}'. Every
    client that reaches the host may ask: any but this machine's needs --let-anybody-connect.
    """
    import rpyc  # pyright: ignore[reportMissingImports]
    from vlagents.server import AgentService  # pyright: ignore[reportMissingImports]

    class Service(AgentService):
        """The server's methods, without the commits and changes of the folder that it runs in."""

        def exposed_git_status(self) -> str:
            """Nothing, as JSON."""
            return "{}"

    if not let_anybody_connect:
        _check_host(host)
    agents = import_module("vlagents").AGENTS
    check_known("agent", agent_name, agents)
    service = Service(agents[agent_name](**json.loads(kwargs)), agent_name)
    options = {"include_local_traceback": False}
    with service:
        rpyc.ThreadedServer(service, hostname=host, port=port, protocol_config=options).start()


def _check_host(host: str) -> None:
    """Reject an address that others reach.

    Raises:
        ServingError: If they do.
    """
    if not is_loopback(host):
        raise ServingError(
            f"A server of VLAgents at {host or 'every address'} answers everybody who reaches it, "
            "without a key. Serve at 127.0.0.1, and reach it through an SSH tunnel; in a network "
            "that you trust, `start-server` has the option --let-anybody-connect."
        )


def _app() -> Any:
    """VLAgents' command line, whose server is ours."""
    evaluation: Any = import_module("vlagents.eval")
    main_app = import_module("vlagents.__main__").main_app
    main_app.command("start-server")(start_server)
    theirs = evaluation.start_server

    def started(agent_name: str, *options: Any) -> AbstractContextManager[Any]:
        """The server that an evaluation asks; theirs would not know our agent."""
        return (_server if agent_name == AGENT else theirs)(agent_name, *options)

    evaluation.start_server = started
    return main_app


@contextmanager
def _server(
    agent_name: str,
    kwargs: dict[str, Any],
    port: int = 8080,
    host: str = "localhost",
    python_path: str = sys.executable,
) -> Iterator[subprocess.Popen[bytes]]:
    """A server in a process of its own, as long as the block lasts."""
    _check_host(host)
    command = [python_path.format(agent_name=agent_name), "-m", __package__ or "", "start-server"]
    options = [f"--port={port}", f"--host={host}", f"--kwargs={json.dumps(kwargs)}"]
    process = subprocess.Popen([*command, agent_name, *options])
    try:
        yield process
    finally:
        process.send_signal(signal.SIGINT)
        with suppress(subprocess.TimeoutExpired):
            process.wait(_END_S)
        process.kill()
        process.wait()


if __name__ == "__main__":
    main()
