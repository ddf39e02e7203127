"""Films of recorded runs, rendered off-screen in processes of their own."""
