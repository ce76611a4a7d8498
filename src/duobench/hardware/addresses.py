"""What an arm's address can be."""

import re
from ipaddress import AddressValueError, IPv4Address


def is_host(text: str) -> bool:
    """Whether it is a host name or an address of the Internet protocol's version 4."""
    if re.fullmatch(r"[\d.]+", text):
        try:
            IPv4Address(text)
        except AddressValueError:
            return False
    return re.fullmatch(r"[\w.-]+", text) is not None


def is_simulator(address: str) -> bool:
    """Whether an arm's address is this computer, where only a simulator of arms can be."""
    return address == "localhost" or address.startswith("127.")
