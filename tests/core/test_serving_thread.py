import asyncio
import random
from contextlib import closing

from websockets.asyncio.server import ServerConnection
from websockets.sync.client import connect

from duobench.core.serving_thread import ServingThread


def test_pings_draw_nothing_from_the_generator_that_policies_draw_from() -> None:
    async def wait_for_pong(socket: ServerConnection) -> None:
        while not socket.latency:
            await asyncio.sleep(0.01)
        await socket.send("pinged")

    server = ServingThread(wait_for_pong, "127.0.0.1", 0, name="pings", ping_interval=0.01)
    with closing(server):
        before = random.getstate()
        with connect(f"ws://127.0.0.1:{server.port}", ping_interval=None) as client:
            assert client.recv(timeout=20) == "pinged"
        assert random.getstate() == before
