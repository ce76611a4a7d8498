"""Results: what a run is, the records of its episodes, and what they add up to.

Nothing here plays an episode. What users need of it is public in `duobench.evaluation`.
"""
