"""Experiments as TOML files: what one may say, and what is said of a wrong one."""
