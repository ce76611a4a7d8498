"""How one might cheat in bin_sort."""

from tests.adversaries.adversary import Adversary

ADVERSARIES: tuple[Adversary, ...] = ()
