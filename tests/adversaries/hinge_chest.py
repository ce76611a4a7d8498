"""How one might cheat in hinge_chest."""

from tests.adversaries.adversary import Adversary

ADVERSARIES: tuple[Adversary, ...] = ()
