"""How one might cheat in join_blocks."""

from tests.adversaries.adversary import Adversary

ADVERSARIES: tuple[Adversary, ...] = ()
