"""Addresses of arms."""

import re
from ipaddress import AddressValueError, IPv4Address


def is_host(text: str) -> bool:
    """Whether it is a host name or an address of the Internet protocol's version 4."""
    if re.fullmatch(r"[\d.]+", text):
        return _address(text) is not None
    return re.fullmatch(r"[\w.-]+", text) is not None


def is_simulator(text: str) -> bool:
    """Whether an arm's address is this computer, where only a simulator of arms can be."""
    address = _address(text)
    return text == "localhost" if address is None else address.is_loopback


def share_subnet(one: str, other: str) -> bool:
    """Whether two addresses lie in one subnet of 256; host names and simulators never do."""
    found = _address(one), _address(other)
    if None in found or any(map(is_simulator, (one, other))):
        return False
    return one.rpartition(".")[0] == other.rpartition(".")[0]


def _address(text: str) -> IPv4Address | None:
    try:
        return IPv4Address(text)
    except AddressValueError:
        return None
