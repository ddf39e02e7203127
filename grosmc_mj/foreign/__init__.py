"""Plants from other packages' models, read as they are."""
