"""Episodes in a browser: recorded ones, those of a run, and those that are being played.

It stands here because it joins what data sets, runs and the page know of each other.
"""
