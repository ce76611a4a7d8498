"""How one might cheat in carry_pot."""

from tests.adversaries.adversary import Adversary

ADVERSARIES: tuple[Adversary, ...] = ()
