"""What steps a closed loop: Python's own loop, and MuJoCo's with a compiled law."""
