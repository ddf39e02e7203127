"""What the claims measure, a module a system and what several share."""
