"""What the chapter's law leaves out: holding pole and cart at once."""
