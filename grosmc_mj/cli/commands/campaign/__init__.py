"""grosmc-mj campaign: many uncertain plants, and the case file of one."""
