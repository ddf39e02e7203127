"""``python -m grosmc_mj`` is ``grosmc-mj``."""

from grosmc_mj.cli.entry import main

if __name__ == "__main__":
    main()
