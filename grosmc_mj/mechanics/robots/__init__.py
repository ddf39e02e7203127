"""Models without equations in symbols: torques in, MuJoCo's M(q) and bias forces as dynamics."""
