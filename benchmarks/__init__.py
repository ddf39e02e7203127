"""Throughput of loops, robots and campaigns, as ratios within one run: `python -m benchmarks`."""
