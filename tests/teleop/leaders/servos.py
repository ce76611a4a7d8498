"""Servos on a pseudo-terminal that answer `ping` and `sync read` [DYNAMIXEL protocol 2.0]."""

from __future__ import annotations

import struct
import threading
from collections.abc import Mapping

from tests.ptys import PseudoTerminal

PING, SYNC_READ, STATUS = 0x01, 0x82, 0x55
HEADER = b"\xff\xff\xfd\x00"


def crc(data: bytes) -> int:
    """CRC-16 with the polynomial 0x8005, bit by bit."""
    value = 0
    for byte in data:
        value ^= byte << 8
        for _ in range(8):
            value = ((value << 1) ^ 0x8005 if value & 0x8000 else value << 1) & 0xFFFF
    return value


def packet(number: int, body: bytes) -> bytes:
    """A packet: header, id, length, body with its patterns of a header broken up, checksum."""
    body = body.replace(b"\xff\xff\xfd", b"\xff\xff\xfd\xfd")
    head = HEADER + bytes([number]) + struct.pack("<H", len(body) + 2) + body
    return head + struct.pack("<H", crc(head))


class Servos:
    """Some servos at one port; what they show may be changed at any time."""

    def __init__(self, counts: Mapping[int, int]) -> None:
        self.counts = dict(counts)
        self.is_silent = False
        self._terminal = PseudoTerminal()
        self.port = self._terminal.port
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def close(self) -> None:
        self._stop.set()
        self._thread.join()
        self._terminal.close()

    def _run(self) -> None:
        data = b""
        while not self._stop.is_set():
            data += self._terminal.read()
            while (length := self._whole(data)) is not None:
                asked, data = data[:length], data[length:]
                assert struct.pack("<H", crc(asked[:-2])) == asked[-2:]
                if not self.is_silent:
                    self._terminal.write(self._answer(asked[4], asked[7:-2]))

    def _whole(self, data: bytes) -> int | None:
        if len(data) < 7:
            return None
        assert data.startswith(HEADER)
        length = 7 + struct.unpack_from("<H", data, 5)[0]
        return length if len(data) >= length else None

    def _answer(self, number: int, body: bytes) -> bytes:
        if body[0] == PING:
            is_here = number in self.counts
            return packet(number, bytes([STATUS, 0, 0xB0, 0x04, 45])) if is_here else b""
        assert body[0] == SYNC_READ
        assert struct.unpack_from("<HH", body, 1) == (132, 4)
        return b"".join(
            packet(each, bytes([STATUS, 0]) + struct.pack("<i", self.counts[each]))
            for each in body[5:]
            if each in self.counts
        )
