"""grosmc-mj campaign: many uncertain plants, and one of them again."""
