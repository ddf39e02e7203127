"""Run ``python -m grosmc_mj`` as ``grosmc-mj``."""

from grosmc_mj.cli.entry import main

if __name__ == "__main__":
    main()
