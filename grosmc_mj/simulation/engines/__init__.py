"""What steps a closed loop: one kernel, compiled or as plain Python."""
