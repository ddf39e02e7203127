"""dm_control's Jaco arm, as an example of a robot from elsewhere."""
