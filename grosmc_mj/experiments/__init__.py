"""One case as one object: its file, plants, laws, runs, metrics and requirements.

``file`` reads TOML; ``experiment`` makes of it what is run and judged.
"""
