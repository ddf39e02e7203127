"""Throughput of loops, robots, campaigns and films, as ratios within one run.

One module a kind of work measures it; ``tables`` shows what was measured.
"""
