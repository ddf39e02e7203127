"""MuJoCo's models: their files, and what is refused."""
