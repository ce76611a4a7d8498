"""How one might cheat in spring_door."""

from tests.adversaries.adversary import Adversary

ADVERSARIES: tuple[Adversary, ...] = ()
