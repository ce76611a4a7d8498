"""A leaderboard: what verified bundles add up to, as a folder of pages that load nothing.

`duobench.replay.leaderboard` verifies the bundles and calls what is here.
"""
