"""Region: the starts from which each law reaches its goal."""
